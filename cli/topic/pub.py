"""`topic pub`."""

import time
from typing import Annotated, Any, NamedTuple

import msgspec

from quadctl.cli import context, output
from quadctl.cli.concurrent import Pace
from quadctl.cli.context import Options, about_topic, own_topic
from quadctl.cli.declarations import Arg, Option, is_number
from quadctl.cli.names import single_key
from quadctl.cli.values import is_data, is_pairs, is_type, message_of, table_of, without_type
from quadctl.schemas.topics import TOPICS
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import Invalid, QuadctlError, Unreachable, UsageError
from quadctl.services.runtime.params.names import nearest

_ONCE = "-1"


def without_once(words: list[str], fields: int | None, own: str = "") -> tuple[list[str], bool]:
    """The words of a message without a `-1` at either end of it, and whether there was one.

    `fields` is how many the topic's type `own` has, None where that is not known.
    """
    for end, rest in ((words[-1:], words[:-1]), (words[:1], words[1:])):
        if end == [_ONCE] and rest and not _is_value(rest, fields, own):
            return rest, True
    return words, False


def _is_value(rest: list[str], fields: int | None, own: str) -> bool:
    """Whether a -1 is one value more beside the rest of a message."""
    if len(rest) == 1 and is_type(rest[0], own):
        return True
    values = without_type(rest, own)
    if is_data(values) or is_pairs(values):
        return False
    # A row of known length has room for it or not; another one is a row of numbers.
    return len(values) < fields if fields is not None else all(map(is_number, values))


FORMS = {
    "json": "application/json",
    "msgpack": "application/msgpack",
    "text": "text/plain",
    "hex": "zenoh/bytes",
}
"""The encoding of each form that a strange key's payload can be given."""


class Payload(NamedTuple):
    """Bytes, and what they are."""

    data: bytes
    encoding: str


def payload_of(key: str, vehicle: str, words: list[str], form: str) -> Payload:
    """The words as a payload for a key: of our topics typed and checked, else in a form.

    Raises Invalid for what cannot be sent, UsageError for words that say nothing.
    """
    if form and form not in FORMS:
        raise UsageError(f"--as {form}: no such form", f"it is one of {', '.join(FORMS)}")
    topic = own_topic(key, vehicle)
    if topic is not None:
        if form:
            raise Invalid(
                f"{key} carries {topic.type.__name__} and nothing else",
                f"leave --as out; `quadctl type show {topic.name}` prints the fields",
            )
        type_: Any = topic.type
        message = message_of(type_, topic.name, words)
        return Payload(codec.encode(message), codec.encoding(type_))
    words = without_type(words)
    if not words:
        raise UsageError("there is nothing to send", "write name=value words, JSON, or a text")
    form = form or _form_of(words)
    return Payload(_bytes(words, form), FORMS[form])


def split_once(key: str, vehicle: str, words: list[str]) -> tuple[list[str], bool]:
    """The words without rostopic's -1 where it is not a value for a key; whether there was one."""
    if (topic := own_topic(key, vehicle)) is None:
        return without_once(words, None)
    return without_once(words, len(topic.type.__struct_fields__), topic.type.__name__)


def _form_of(words: list[str]) -> str:
    """A table, a list or several values are data; one word alone is sent as it stands."""
    return "text" if len(words) == 1 and not is_data(words) and not is_pairs(words) else "json"


def _bytes(words: list[str], form: str) -> bytes:
    if form == "text":
        return " ".join(words).encode()
    if form == "hex":
        try:
            return bytes.fromhex("".join(words))
        except ValueError as error:
            raise Invalid(
                f"{' '.join(words)[:80]} is not hex: {error}", "write two digits a byte"
            ) from error
    value = table_of(words)
    try:
        return msgspec.json.encode(value) if form == "json" else msgspec.msgpack.encode(value)
    except (OverflowError, TypeError, RecursionError, UnicodeEncodeError) as error:
        raise Invalid(f"it cannot be sent as {form}: {error}") from error


_FASTEST = 10_000.0
_LOOK = 0.1
"""Seconds for finding the name that is meant, once the timeout is over."""
_LAST = 0.5
"""Seconds in which the hub is to say, after Ctrl-C, that it has all."""
_DEFAULT_HZ = 10.0
"""What rostopic takes where many messages are wanted and no rate is given."""


def pub(
    options: Options,
    topic: Annotated[str, Arg("A topic, or any Zenoh key.", complete="topic")],
    arguments: Annotated[
        list[str] | None,
        Arg(
            "As x=1 pose.y=2, as JSON, {x: 1} or x: 1 in lines, or as values in order.",
            complete="field",
        ),
    ] = None,
    rate: Annotated[
        float | None, Option("Messages a second, until -n of them or Ctrl-C.", ("-r", "--rate"))
    ] = None,
    count: Annotated[int | None, Option("End after so many messages.", ("-n",), min=1)] = None,
    once: Annotated[bool, Option("Send one message: so it is without -r and -n.")] = False,
    form: Annotated[
        str, Option("What a key of no known type gets: json, msgpack, text or hex.", ("--as",))
    ] = "",
    no_wait: Annotated[bool, Option("Send at once, whether anybody listens or not.")] = False,
) -> None:
    """Publish one message, or with -r many, as soon as somebody listens.

    What goes to a topic of ours is checked against its type. rostopic's -1 is understood before the
    topic and beside a message, but in a row of numbers, as x y -1, it is one of them; and so is a
    type before the message, which is not needed.

    Example: quadctl topic pub input/position_request x=1 y=2 z=1
    """
    words = arguments or []
    if topic == "-1" and words:
        (topic, *words), once = words, True
    options = about_topic(options, topic)
    key = single_key(topic, options.vehicle)
    words, said = split_once(key, options.vehicle, words)
    wanted = _count(rate, count, once=once or said)
    payload = payload_of(key, options.vehicle, words, form)
    with context.connect(options) as client:
        _warn(key, client.vehicle)
        sent = _send(client, key, payload, wanted, rate or _DEFAULT_HZ, wait=not no_wait)
    output.either(
        options,
        {"key": key, "sent": sent, "encoding": payload.encoding},
        f"sent {sent} message{'s' if sent > 1 else ''} on {key}",
    )


def _count(rate: float | None, count: int | None, *, once: bool) -> int | None:
    """How many messages are wanted; None without an end."""
    if rate is not None and not 0 < rate <= _FASTEST:
        raise Invalid(f"--rate {rate:g}: not a rate", f"give Hz, more than 0, up to {_FASTEST:g}")
    if once and (rate is not None or (count or 1) > 1):
        raise UsageError("--once goes neither with --rate nor with -n", "leave one of them out")
    return count if rate is not None or count else 1


def _warn(key: str, vehicle: str) -> None:
    if (topic := own_topic(key, vehicle)) is not None and topic.node:
        output.note(f"warning: {key} is {topic.node}'s own: who reads it cannot tell yours from it")


def _nobody(client: Client, key: str) -> QuadctlError:
    """That nobody listens, with the nearest name that there is."""
    nobody = f"nobody listened on {key} within {client.timeout:g} s: nothing was sent"
    try:
        offers = client.endpoints(_LOOK)
    except QuadctlError as other:
        return type(other)(f"{nobody}: {other.message}", other.hint)
    # Who listens is not announced: what is ours, or published, is likelier than another name.
    names = {offer.key for offer in offers if offer.kind == "@pub"}
    names |= {topic.key(client.vehicle) for topic in TOPICS}
    like = "" if key in names else nearest(key, names)
    hint = f"{like or 'is it spelled right?'} --no-wait sends nevertheless"
    return client.explained(Unreachable(nobody, hint), live=[offer.node for offer in offers])


def _send(
    client: Client, key: str, payload: Payload, wanted: int | None, hz: float, *, wait: bool
) -> int:
    """Send so many messages and return how many; they have reached the hub by then."""
    sent = 0
    outlet = client.raw_publisher(key, payload.encoding)
    if wait and not outlet.wait_for_listener(client.timeout):
        if wanted is not None:
            raise _nobody(client, key)
        output.note(f"nobody listens on {key} yet")
    start, pace = time.monotonic(), Pace(client)
    try:
        while wanted is None or sent < wanted:
            pace.rest(start + sent / hz)
            outlet.put(payload.data)
            sent += 1
    except KeyboardInterrupt:
        output.note(_interrupted(client, key, sent))
        raise
    pace.ask()
    return sent


def _interrupted(client: Client, key: str, sent: int) -> str:
    try:
        client.flush(_LAST)
    except QuadctlError as problem:
        return f"of {sent} messages on {key} a part may be lost: {problem.message}"
    return f"sent {sent} messages on {key}"
