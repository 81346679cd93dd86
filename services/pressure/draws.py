"""Random numbers as the sensor takes them: passed in, so that a seed makes a flight again."""

from typing import Protocol


class Draws(Protocol):
    """A stream of random numbers, such as a seeded `random.Random`."""

    def uniform(self, a: float, b: float, /) -> float:
        """A number in [a, b], all equally likely."""

    def gauss(self, mu: float, sigma: float, /) -> float:
        """A number of the normal distribution."""
