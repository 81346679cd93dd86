"""`topic hz`, `bw` and `delay`."""

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Annotated, Any, NamedTuple

from quadctl.cli import context, output
from quadctl.cli.context import Options, about_topic
from quadctl.cli.declarations import Arg, Option
from quadctl.cli.names import checked_key, live_key
from quadctl.services.runtime.bus.streams import RawMessage
from quadctl.services.runtime.errors import Invalid


class Arrival(NamedTuple):
    """Arrival of a message: the time (s, monotonic), its size (bytes), its age (s) then."""

    received: float
    size: int
    age: float


class Figures(NamedTuple):
    """Figures as a document and as text."""

    document: dict[str, Any]
    text: str


Measure = Callable[[Sequence[Arrival]], Figures]


def rate(arrivals: Sequence[Arrival]) -> Figures:
    """Return messages per second and the spread of their gaps (s), from two messages or more."""
    times = [message.received for message in arrivals]
    gaps = [b - a for a, b in pairwise(times)]
    hz = _per(len(gaps), times)
    return Figures(
        {"hz": hz, **_spread(gaps), "n": len(arrivals)},
        f"average rate: {hz:.3f}\n\t{_seconds(gaps, 3, 5)} window: {len(arrivals)}",
    )


def bandwidth(arrivals: Sequence[Arrival]) -> Figures:
    """Return bytes per second and the spread of the sizes, from two messages or more.

    The first message was sent before the measured time, so its bytes do not count.
    """
    sizes = [message.size for message in arrivals]
    per_second = _per(sum(sizes[1:]), [message.received for message in arrivals])
    mean = sum(sizes) / len(sizes)
    low, high = min(sizes), max(sizes)
    return Figures(
        {"bytes_per_second": per_second, "mean": mean, "min": low, "max": high, "n": len(arrivals)},
        f"average: {_bytes(per_second)}/s\n\tmean: {_bytes(mean)} min: {_bytes(low)}"
        f" max: {_bytes(high)} window: {len(arrivals)}",
    )


def delay_figures(arrivals: Sequence[Arrival]) -> Figures:
    """Return the mean age on arrival (s) and its spread, from one message or more."""
    ages = [message.age for message in arrivals]
    mean = math.fsum(ages) / len(ages)
    return Figures(
        {"delay": mean, **_spread(ages), "n": len(arrivals)},
        f"average delay: {mean:.6f}\n\t{_seconds(ages, 6, 6)} window: {len(arrivals)}",
    )


def _per(amount: float, times: Sequence[float]) -> float:
    # Two messages can arrive in one tick of the clock.
    return amount / max(times[-1] - times[0], 1e-9)


def _spread(values: Sequence[float]) -> dict[str, float]:
    mean = math.fsum(values) / len(values)
    variance = math.fsum((value - mean) ** 2 for value in values) / len(values)
    return {"min": min(values), "max": max(values), "std": math.sqrt(variance)}


def _seconds(values: Sequence[float], digits: int, more: int) -> str:
    """Format the spread as rostopic does, the deviation with `more` digits."""
    low, high, std = _spread(values).values()
    return f"min: {low:.{digits}f}s max: {high:.{digits}f}s std dev: {std:.{more}f}s"


def _bytes(amount: float) -> str:
    """Format an amount as rostopic does: B, KB of a thousand, MB of a million."""
    for unit, size in (("MB", 1e6), ("KB", 1e3)):
        if amount >= size:
            return f"{amount / size:.2f}{unit}"
    return f"{amount:.2f}B"


_PERIOD = 1.0
"""Seconds between two lines of output."""
_LONGEST = 50_000
"""Messages in the window if none is given, as in rostopic."""

Topic = Annotated[
    str, Arg("A topic, any Zenoh key, or an expression: all its keys together.", complete="topic")
]
Window = Annotated[int | None, Option("Messages in the window.", ("-w", "--window"), min=2)]
Count = Annotated[int | None, Option("End after so many messages.", ("-n",), min=2)]


def hz(options: Options, topic: Topic, window: Window = None, count: Count = None) -> None:
    """Measure the rate of messages, by their arrival, until Ctrl-C.

    Example: quadctl topic hz pose -n 100
    """
    _measure(options, topic, window or _LONGEST, count, rate)


def bw(options: Options, topic: Topic, window: Window = 100, count: Count = None) -> None:
    """Measure the bytes per second of the payloads, until Ctrl-C.

    Example: quadctl topic bw pose
    """
    _measure(options, topic, window or _LONGEST, count, bandwidth)


def delay(options: Options, topic: Topic, window: Window = None, count: Count = None) -> None:
    """Measure the age of messages on arrival, by their sender's time stamps, until Ctrl-C.

    Only on the same machine are the two clocks the same. Without a sender's stamp the hub's counts.

    Example: quadctl topic delay pose
    """
    _measure(options, topic, window or _LONGEST, count, delay_figures)


def _measure(
    options: Options, topic: str, window: int, count: int | None, measure: Measure
) -> None:
    options = about_topic(options, topic)
    key = checked_key(topic, options.vehicle)
    arrivals: deque[Arrival] = deque(maxlen=window)
    seen, printed, due = 0, 0, time.monotonic() + _PERIOD

    def show() -> None:
        figures = measure(arrivals)
        output.either(options, {"key": key, **figures.document}, figures.text)

    with context.connect(options) as client:
        key = live_key(client, key)
        stream = client.listen(key)
        ends = time.monotonic() + client.timeout
        while count is None or seen < count:
            message = stream.next(min(due, ends) - time.monotonic())
            now = time.monotonic()
            if message is not None:
                arrivals.append(_arrival(message, aged=measure is delay_figures))
                seen, ends = seen + 1, now + client.timeout
            elif now >= ends:
                raise client.silent(key, more=seen > 0)
            if now >= due:
                due = now + _PERIOD
                # With -n and --json only the last document is printed.
                if seen > max(printed, 1) and not (options.json and count):
                    show()
                    printed = seen
    if seen > printed:
        show()


def _arrival(message: RawMessage, *, aged: bool) -> Arrival:
    if aged and message.age is None:
        hint = "enable timestamping in the session of its publisher"
        raise Invalid(f"a message on {message.key} has no time stamp, so its age is unknown", hint)
    return Arrival(message.at / 1e9, len(message.payload), message.age or 0.0)
