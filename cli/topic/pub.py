"""`topic pub`."""

import time
from typing import Annotated, Any, NamedTuple

import msgspec

from quadctl.cli import context, output
from quadctl.cli.context import Options, about_topic, own_topic
from quadctl.cli.declarations import Arg, Option, is_number
from quadctl.cli.names import single_key
from quadctl.cli.values import is_data, is_pairs, is_type, message_of, table_of, without_type
from quadctl.schemas.topics import TOPICS
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.client import Client, Pace
from quadctl.services.runtime.errors import Invalid, QuadctlError, Unreachable, UsageError
from quadctl.services.runtime.params.names import nearest

_ONCE = "-1"


def without_once(words: list[str], fields: int | None, own: str = "") -> tuple[list[str], bool]:
    """Return a message's words without a `-1` at either end, and whether there was one.

    `fields` is the number of fields of the topic's type `own`, None if unknown.
    """
    for end, rest in ((words[-1:], words[:-1]), (words[:1], words[1:])):
        if end == [_ONCE] and rest and not _is_value(rest, fields, own):
            return rest, True
    return words, False


def _is_value(rest: list[str], fields: int | None, own: str) -> bool:
    """Return whether a -1 is one more value beside the rest of a message."""
    if len(rest) == 1 and is_type(rest[0], own):
        return True
    values = without_type(rest, own)
    if is_data(values) or is_pairs(values):
        return False
    # A known type may have room for one more value; for an unknown one, all must be numbers.
    return len(values) < fields if fields is not None else all(map(is_number, values))


FORMS = {
    "json": "application/json",
    "msgpack": "application/msgpack",
    "text": "text/plain",
    "hex": "zenoh/bytes",
}
"""Encodings by form, for the payload of a key without a declared type."""


class Payload(NamedTuple):
    """Bytes of a message and their encoding."""

    data: bytes
    encoding: str


def payload_of(key: str, vehicle: str, words: list[str], form: str) -> Payload:
    """Encode the words for a key: for a declared topic typed and checked, else in a form.

    Raises Invalid for a message that cannot be sent, UsageError for no words or an unknown form.
    """
    if form and form not in FORMS:
        raise UsageError(f"--as {form}: no such form", f"it is one of {', '.join(FORMS)}")
    topic = own_topic(key, vehicle)
    if topic is not None:
        if form:
            hint = f"leave --as out; `quadctl type show {topic.name}` prints the fields"
            raise Invalid(f"{key} carries {topic.type.__name__} and nothing else", hint)
        type_: Any = topic.type
        message = message_of(type_, topic.name, words)
        return Payload(codec.encode(message), codec.encoding(type_))
    words = without_type(words)
    if not words:
        raise UsageError("no message is given", "write name=value words, JSON, or a text")
    form = form or _form_of(words)
    return Payload(_bytes(words, form), FORMS[form])


def split_once(key: str, vehicle: str, words: list[str]) -> tuple[list[str], bool]:
    """Return the words without rostopic's -1, unless it is a value, and whether there was one."""
    if (topic := own_topic(key, vehicle)) is None:
        return without_once(words, None)
    return without_once(words, len(topic.type.__struct_fields__), topic.type.__name__)


def _form_of(words: list[str]) -> str:
    """Return `json` for a table, a list or several values, `text` for a single word."""
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
"""Seconds for the search for the nearest name, after the timeout."""
_LAST = 0.5
"""Seconds for the hub to confirm all messages after Ctrl-C."""
_DEFAULT_HZ = 10.0
"""rostopic's rate (Hz) for many messages without a given rate."""


def pub(
    options: Options,
    topic: Annotated[str, Arg("A topic, or any Zenoh key.", complete="topic")],
    arguments: Annotated[
        list[str] | None,
        Arg("x=1 pose.y=2, JSON, {x: 1} or x: 1 in lines, or values in order.", complete="field"),
    ] = None,
    rate: Annotated[
        float | None, Option("Messages per second, until -n of them or Ctrl-C.", ("-r", "--rate"))
    ] = None,
    count: Annotated[int | None, Option("End after so many messages.", ("-n",), min=1)] = None,
    once: Annotated[bool, Option("Send one message (default, without -r and -n).")] = False,
    form: Annotated[
        str, Option("Form for a key of no known type: json, msgpack, text or hex.", ("--as",))
    ] = "",
    no_wait: Annotated[bool, Option("Send at once, without waiting for a listener.")] = False,
) -> None:
    """Publish one message, or with -r many, as soon as the topic has a listener.

    A message to a declared topic is checked against its type. rostopic's -1 is accepted before the
    topic and beside a message, but in a row of numbers, e.g. x y -1, it is a value. A type before
    the message is accepted, too, and not needed.

    Example: quadctl topic pub input/position_request x=1 y=2 z=1
    """
    words = arguments or []
    if topic == "-1" and words:
        (topic, *words), once = words, True
    options = about_topic(options, topic)
    key = single_key(topic, options.vehicle)
    words, minus_one = split_once(key, options.vehicle, words)
    wanted = _count(rate, count, once=once or minus_one)
    payload = payload_of(key, options.vehicle, words, form)
    with context.connect(options) as client:
        _warn(key, client.vehicle)
        sent = _send(client, key, payload, wanted, rate or _DEFAULT_HZ, wait=not no_wait)
    document = {"key": key, "sent": sent, "encoding": payload.encoding}
    output.either(options, document, f"sent {sent} message{'s' if sent > 1 else ''} on {key}")


def _count(rate: float | None, count: int | None, *, once: bool) -> int | None:
    """Return the number of messages to send; None for no end."""
    if rate is not None and not 0 < rate <= _FASTEST:
        raise Invalid(f"--rate {rate:g}: not a rate", f"give Hz, more than 0, up to {_FASTEST:g}")
    if once and (rate is not None or (count or 1) > 1):
        raise UsageError("--once goes neither with --rate nor with -n", "leave one of them out")
    return count if rate is not None or count else 1


def _warn(key: str, vehicle: str) -> None:
    if (topic := own_topic(key, vehicle)) is not None and topic.node:
        output.note(f"warning: {key} is {topic.node}'s own: its readers cannot spot your messages")


def _no_listener(client: Client, key: str) -> QuadctlError:
    """Return the error for a topic without listeners, with the nearest name that exists."""
    message = f"no listener on {key} within {client.timeout:g} s: nothing was sent"
    try:
        offers = client.endpoints("@pub", "@srv", "@sub", timeout=_LOOK)
    except QuadctlError as other:
        return type(other)(f"{message}: {other.message}", other.hint)
    # A listener that is no node is not announced; the likeliest names are announced or declared.
    names = {offer.key for offer in offers if offer.kind != "@srv"}
    names |= {topic.key(client.vehicle) for topic in TOPICS}
    similar = "" if key in names else nearest(key, names)
    hint = f"{similar or 'is it spelled right?'} --no-wait sends anyway"
    return client.explained(Unreachable(message, hint), live=[offer.node for offer in offers])


def _send(
    client: Client, key: str, payload: Payload, wanted: int | None, hz: float, *, wait: bool
) -> int:
    """Send messages until `wanted` have reached the hub (None: no end); return their number."""
    sent = 0
    outlet = client.raw_publisher(key, payload.encoding)
    if wait and not outlet.wait_for_listener(client.timeout):
        if wanted is not None:
            raise _no_listener(client, key)
        output.note(f"no listener on {key} yet")
    start, pace = time.monotonic(), Pace(client)
    try:
        while wanted is None or sent < wanted:
            pace.sleep_until(start + sent / hz)
            outlet.put(payload.data)
            sent += 1
    except KeyboardInterrupt:
        output.note(_interrupted(client, key, sent))
        raise
    pace.check()
    return sent


def _interrupted(client: Client, key: str, sent: int) -> str:
    try:
        client.flush(_LAST)
    except QuadctlError as problem:
        return f"of {sent} messages on {key} some may be lost: {problem.message}"
    return f"sent {sent} messages on {key}"
