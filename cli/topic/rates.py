"""`topic hz|bw|delay`: how often, how much, how late; told about once a second."""

import time
from collections import deque
from typing import Annotated

from cli import bus, output
from cli.declare import Arg, Opt
from cli.names import checked_key
from cli.options import Options
from cli.topic.figures import Heard, Measure, bandwidth, rate
from cli.topic.figures import delay as delay_of
from cli.which import about_topic
from services.runtime.bus.streams import Message
from services.runtime.errors import Invalid

_PERIOD = 1.0
"""Seconds from one line to the next."""
_LONGEST = 50_000
"""Messages that are kept where no window is given, as rostopic has it."""

Topic = Annotated[
    str, Arg("A topic, any Zenoh key, or an expression: all its keys together.", complete="topic")
]
Window = Annotated[int | None, Opt("Count the last so many messages.", ("-w", "--window"), min=2)]
Count = Annotated[int | None, Opt("End after so many messages.", ("-n",), min=2)]


def hz(options: Options, topic: Topic, window: Window = None, count: Count = None) -> None:
    """Measure how often messages come, by their arrival, until Ctrl-C.

    Example: quadctl topic hz pose -n 100
    """
    _measure(options, topic, window or _LONGEST, count, rate)


def bw(options: Options, topic: Topic, window: Window = 100, count: Count = None) -> None:
    """Measure how many bytes come, until Ctrl-C; those of the payloads alone.

    Example: quadctl topic bw pose
    """
    _measure(options, topic, window or _LONGEST, count, bandwidth)


def delay(options: Options, topic: Topic, window: Window = None, count: Count = None) -> None:
    """Measure how old messages are on arrival, by the time that their sender stamped, until Ctrl-C.

    The two clocks are the same on the same machine only. A sender that stamps nothing gets the
    hub's time.

    Example: quadctl topic delay pose
    """
    _measure(options, topic, window or _LONGEST, count, delay_of)


def _measure(
    options: Options, topic: str, window: int, count: int | None, measure: Measure
) -> None:
    options = about_topic(options, topic)
    key = checked_key(topic, options.vehicle)
    heard: deque[Heard] = deque(maxlen=window)
    seen, told, due = 0, 0, time.monotonic() + _PERIOD

    def tell() -> None:
        figures = measure(heard)
        output.either(options, {"key": key, **figures.document}, figures.text)

    with bus.connect(options) as client:
        stream = client.listen(key)
        ends = time.monotonic() + client.timeout
        while count is None or seen < count:
            message = stream.next(min(due, ends) - time.monotonic())
            now = time.monotonic()
            if message is not None:
                heard.append(_heard(message, aged=measure is delay_of))
                seen, ends = seen + 1, now + client.timeout
            elif now >= ends:
                raise client.silent(key, more=seen > 0)
            if now >= due:
                due = now + _PERIOD
                # With -n and --json one document is asked for: the last.
                if seen > max(told, 1) and not (options.json and count):
                    tell()
                    told = seen
    if seen > told:
        tell()


def _heard(message: Message, *, aged: bool) -> Heard:
    if aged and message.age is None:
        raise Invalid(
            f"a message on {message.key} bears no time, so its age cannot be told",
            "let its publisher open its session with timestamping enabled",
        )
    return Heard(message.received, len(message.payload), message.age or 0.0)
