"""What `topic hz`, `bw` and `delay` say of the messages in their window; pure."""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple


class Heard(NamedTuple):
    """Of one message: its arrival (s, monotonic), its size (bytes) and its age (s) then."""

    received: float
    size: int
    age: float


class Figures(NamedTuple):
    """The same figures as a document and as text."""

    document: dict[str, Any]
    text: str


Measure = Callable[[Sequence[Heard]], Figures]


def rate(heard: Sequence[Heard]) -> Figures:
    """Messages a second, and how their gaps (s) vary; of two messages or more."""
    times = [message.received for message in heard]
    gaps = [b - a for a, b in pairwise(times)]
    hz = _per(len(gaps), times)
    return Figures(
        {"hz": hz, **_spread(gaps), "n": len(heard)},
        f"average rate: {hz:.3f}\n\t{_seconds(gaps, 3, 5)} window: {len(heard)}",
    )


def bandwidth(heard: Sequence[Heard]) -> Figures:
    """Bytes a second, and how the sizes vary; of two messages or more.

    The first message was sent before the time that is counted, so its bytes are not.
    """
    sizes = [message.size for message in heard]
    per_second = _per(sum(sizes[1:]), [message.received for message in heard])
    mean = sum(sizes) / len(sizes)
    low, high = min(sizes), max(sizes)
    return Figures(
        {"bytes_per_second": per_second, "mean": mean, "min": low, "max": high, "n": len(heard)},
        f"average: {_bytes(per_second)}/s\n\tmean: {_bytes(mean)} min: {_bytes(low)}"
        f" max: {_bytes(high)} window: {len(heard)}",
    )


def delay(heard: Sequence[Heard]) -> Figures:
    """The mean age on arrival (s), and how it varies; of one message or more."""
    ages = [message.age for message in heard]
    mean = math.fsum(ages) / len(ages)
    return Figures(
        {"delay": mean, **_spread(ages), "n": len(heard)},
        f"average delay: {mean:.6f}\n\t{_seconds(ages, 6, 6)} window: {len(heard)}",
    )


def _per(amount: float, times: Sequence[float]) -> float:
    # Two messages can come in one tick of the clock; as fast as that is fast enough to say.
    return amount / max(times[-1] - times[0], 1e-9)


def _spread(values: Sequence[float]) -> dict[str, float]:
    mean = math.fsum(values) / len(values)
    variance = math.fsum((value - mean) ** 2 for value in values) / len(values)
    return {"min": min(values), "max": max(values), "std": math.sqrt(variance)}


def _seconds(values: Sequence[float], digits: int, more: int) -> str:
    """The spread as rostopic writes it, the deviation with digits of its own."""
    low, high, std = _spread(values).values()
    return f"min: {low:.{digits}f}s max: {high:.{digits}f}s std dev: {std:.{more}f}s"


def _bytes(amount: float) -> str:
    """An amount as rostopic writes it: B, KB of a thousand, MB of a million."""
    for unit, size in (("MB", 1e6), ("KB", 1e3)):
        if amount >= size:
            return f"{amount / size:.2f}{unit}"
    return f"{amount:.2f}B"
