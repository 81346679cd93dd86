"""Statistics of a campaign over the rows of its database, in constant memory."""

from collections import Counter
from collections.abc import Iterable
from math import log, log10

import numpy as np

from quadctl.schemas.typed import json_decoder
from quadctl.services.runtime.errors import Invalid
from quadctl.services.safety.automaton import RULES, Rule
from quadctl.services.safety.model import State

LEAST, DECADES, PARTS = 1e-6, 8, 5
"""Smallest excursion with a bin of its own (m), decades above it, and bins in a decade."""
CONFIDENCE = 0.95

COLUMNS = "worst_excursion, wind, faults, guards"
"""Columns of the table `flights` that a Breakdown takes."""


class Breakdown:
    """Counts of excursions by their size, and of fired rules by disturbance."""

    def __init__(self, rows: Iterable[tuple[float, str, str, str]]) -> None:
        """Count rows with the columns COLUMNS; raise Invalid without rows, or for a strange rule."""
        self.excursions = [0] * (DECADES * PARTS + 1)
        """Flights by excursion: none, then by size; the last bin takes all larger ones."""
        flights, fired = Counter[tuple[str, ...]](), dict[tuple[str, ...], Counter[str]]()
        for excursion, wind, faults, guards in rows:
            self.excursions[_bin(excursion)] += 1
            winds = ["wind"] if any(_WIND.decode(wind)) else []
            disturbances = (*winds, *sorted(_COUNTS.decode(faults)))
            flights[disturbances] += 1
            fired.setdefault(disturbances, Counter()).update(_COUNTS.decode(guards))
        if not flights:
            raise Invalid("the campaign has no flights", "fly some, then write its report")
        self.flights, every = Counter[str](), dict[str, Counter[str]]()
        """Flights with each disturbance; a flight may have several."""
        for disturbances, count in flights.items():
            for name in ("all", *(disturbances or ("none",))):
                self.flights[name] += count
                every.setdefault(name, Counter()).update(fired[disturbances])
        self.fired = dict(sorted(every.items(), key=lambda each: (_rank(each[0]), each[0])))
        """How often each rule fired in these flights: all, without any, in wind, by fault."""
        if unknown := self.fired["all"].keys() - {str(rule) for rule in RULES}:
            raise Invalid(
                f"the campaign fired rules that this automaton lacks: {', '.join(sorted(unknown))}",
                "write the report with the version of quadctl that flew it",
            )


_WIND = json_decoder(tuple[float, float])
_COUNTS = json_decoder(dict[str, int])


def _rank(name: str) -> int:
    return {"all": 0, "none": 1, "wind": 2}.get(name, 3)


def _bin(excursion: float) -> int:
    if excursion <= 0:
        return 0
    part = int(PARTS * log10(max(excursion, LEAST) / LEAST))
    return 1 + min(part, DECADES * PARTS - 1)


def upper_bound(violations: int, flights: int) -> float:
    """Return the upper confidence bound on the probability of a violation in a flight.

    It is exact and one-sided (Clopper, Pearson): the probability at which so few violations, or
    fewer, would have a chance of 1 - CONFIDENCE.
    """
    if violations == flights:
        return 1.0
    fewer = np.arange(violations + 1)
    ways = np.cumsum(np.log(np.append(1.0, (flights - fewer[:-1]) / fewer[1:])))
    low, high = violations / flights, 1.0
    while low < (middle := (low + high) / 2) < high:
        chances = ways + fewer * log(middle) + (flights - fewer) * np.log1p(-middle)
        most = chances.max()
        if most + log(np.exp(chances - most).sum()) > log(1 - CONFIDENCE):
            low = middle
        else:
            high = middle
    return high


def out_of_reach(rule: Rule) -> str:
    """Return why no flight of a campaign can fire a rule; an empty string if one can."""
    match rule.at, rule.on.__name__, rule.when.__name__:
        case _, "Seen", "always":
            return "not counted: a campaign shows safety only poses that may change something"
        case State.VERIFYING, "Check", "permitted" | "from_flight" | "always":
            return ""
        case (State.VERIFYING, _, _) | (_, "Check", _):
            return "a goal is verified in the same call as its request, so nothing comes between"
        case State.MOVING, "Seen", "cornering":
            return "only a way around zones has corners, and a random mission has no zones"
        case State.MOVING, "Goto", "blind":
            return "when poses fail, the rule for Lost ends the flight first"
    return ""
