"""What came of a campaign, from what came of its flights; the same in whatever order they end."""

import hashlib
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from services.campaign.diary import Flown

APART = 1_000_000
"""The flights of a campaign have the seeds from its own times this on, so that none meet."""


def seeds(seed: int, flights: int) -> range:
    """The seed of each flight."""
    return range(seed * APART, seed * APART + flights)


def document(seed: int, flown: Sequence[Flown]) -> dict[str, Any]:
    """The campaign's figures, m and s."""
    flown = sorted(flown, key=lambda flight: flight.seed)
    worst = max(flown, key=lambda flight: flight.worst)
    whole = hashlib.sha256("".join(flight.hash for flight in flown).encode())
    return {
        "flights": len(flown),
        "seed": seed,
        "worst_excursion": worst.worst,
        "worst": {"seed": worst.seed, "at": worst.at},
        "transitions": _sum(flight.transitions for flight in flown),
        "refusals": _sum(flight.refusals for flight in flown),
        "stops": _sum(flight.stops for flight in flown),
        "arrivals": arrivals([time for flight in flown for time in flight.arrivals]),
        "violations": [
            {"seed": flight.seed, "what": flight.violations}
            for flight in flown
            if flight.violations
        ],
        "hash": whole.hexdigest(),
    }


def arrivals(times: list[float]) -> dict[str, float]:
    """How long the flights to a goal took that arrived, s."""
    times = sorted(times)
    parts = {"median": 0.5, "p90": 0.9, "p99": 0.99, "most": 1.0}
    found = {name: times[round(part * (len(times) - 1))] for name, part in parts.items() if times}
    return {"count": len(times), **found}


def _sum(counts: Iterable[dict[str, int]]) -> dict[str, int]:
    total = Counter[str]()
    for each in counts:
        total.update(each)
    return dict(sorted(total.items()))
