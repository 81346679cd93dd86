"""What `topic pub` sends: a key's words as bytes, with the encoding that says what they are."""

from typing import Any, NamedTuple

import msgspec

from cli.topic.once import without_once
from cli.values import is_data, is_pairs, message_of, table_of, without_type
from schemas.topics import Topic, topic_of
from services.runtime.bus import codec
from services.runtime.errors import Invalid, UsageError

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
    topic = _declared(key, vehicle)
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
    if (topic := _declared(key, vehicle)) is None:
        return without_once(words, None)
    return without_once(words, len(topic.type.__struct_fields__), topic.type.__name__)


def _declared(key: str, vehicle: str) -> Topic[Any] | None:
    topic = topic_of(key)
    return topic if topic is not None and key == topic.key(vehicle) else None


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
    return _data(table_of(words), form)


def _data(value: Any, form: str) -> bytes:
    try:
        return msgspec.json.encode(value) if form == "json" else msgspec.msgpack.encode(value)
    except (OverflowError, TypeError, RecursionError, UnicodeEncodeError) as error:
        raise Invalid(f"it cannot be sent as {form}: {error}") from error
