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
    draws = random.Random(island)
    best: list[tuple[float, list[float]]] = []
    for number in range(evaluations * island, evaluations * (island + 1)):
        known: list[float] = []
        if best and draws.random() < 0.8:
            known = list(draws.choice(best)[1])
            for _ in range(draws.randint(1, 4)):
                at = draws.randrange(len(known))
                near = min(max(known[at] + draws.gauss(0, 0.03), 0.0), 1 - 1e-9)
                known[at] = near if draws.random() < 0.7 else draws.random()
        genes = Genes(number, known)
        best.append((rank(genes), genes.drawn))
        best.sort(key=lambda one: one[0])
        del best[_KEPT:]
    return best[0][0]
