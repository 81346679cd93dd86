"""Search by variation: random cases, of which the worst are changed a little and tried again."""

import random
from collections.abc import Callable, Sequence

_KEPT = 40
"""Worst cases that are varied."""


class Genes(random.Random):
    """Random numbers that are kept, so that a case can be drawn again with some of them changed."""

    def __init__(self, seed: int, known: Sequence[float] = ()) -> None:
        super().__init__(seed)
        self._known = known
        self.drawn: list[float] = []

    def random(self) -> float:
        number = len(self.drawn)
        value = self._known[number] if number < len(self._known) else super().random()
        self.drawn.append(value)
        return value


def evolve(rank: Callable[[random.Random], float], evaluations: int, island: int = 0) -> float:
    """Return the lowest rank of so many cases that `rank` draws; each `island` has its own."""
    return evolve_together(lambda genes: [rank(genes[0])], evaluations, island, together=1)


def evolve_together(
    ranks: Callable[[list[Genes]], list[float]], evaluations: int, island: int, *, together: int
) -> float:
    """Return the lowest rank as `evolve`; `ranks` draws so many cases together."""
    draws = random.Random(island)
    best: list[tuple[float, list[float]]] = []
    for first in range(evaluations * island, evaluations * (island + 1), together):
        cases = [Genes(number, _varied(draws, best)) for number in range(first, first + together)]
        best += zip(ranks(cases), (case.drawn for case in cases), strict=True)
        best.sort(key=lambda one: one[0])
        del best[_KEPT:]
    return best[0][0]


def _varied(draws: random.Random, best: list[tuple[float, list[float]]]) -> list[float]:
    """Return the numbers of one of the worst cases with some of them changed, or none."""
    if not best or draws.random() >= 0.8:
        return []
    known = list(draws.choice(best)[1])
    for _ in range(draws.randint(1, 4)):
        at = draws.randrange(len(known))
        near = min(max(known[at] + draws.gauss(0, 0.03), 0.0), 1 - 1e-9)
        known[at] = near if draws.random() < 0.7 else draws.random()
    return known
