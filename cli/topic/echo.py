"""`topic echo`."""

import signal
import sys
import time
from contextlib import ExitStack
from typing import Annotated, Any

import msgspec

from quadctl.cli import context, output
from quadctl.cli.context import Options, about_topic
from quadctl.cli.declarations import Arg, Option
from quadctl.cli.names import checked_key, live_key
from quadctl.schemas.topics import TOPICS, topic_of
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.bus.codec import to_jsonable, unreadable
from quadctl.services.runtime.bus.streams import RawMessage
from quadctl.services.runtime.errors import Invalid, UsageError


def split(name: str) -> tuple[str, str]:
    """Split a name into a declared topic and the path of a field behind it, e.g. `position.x`."""
    bare = name.strip("/")
    for spelling in (bare, bare.partition("/")[2]):
        for topic in TOPICS:
            begin, _, fields = spelling.partition(f"{topic.name}/")
            if not begin and fields.partition("/")[0] in topic.type.__struct_fields__:
                return bare.removesuffix(f"/{fields}"), fields.replace("/", ".")
    return name, ""


class NoField(Invalid):
    """Field that a message does not have."""


def shown(message: RawMessage, key: str, vehicle: str) -> Any:
    """Return a message of a declared topic checked against its type, any other as it can be read.

    `key` is the key subscribed to; unless it is an expression, it determines the topic. Under a
    topic's name, a message of another vehicle or of none is typed only if its encoding is. Raises
    Invalid for an unreadable message.
    """
    of = message.key if "*" in key else key
    declared = topic_of(of)
    ours = of.startswith(f"{vehicle}/") or codec.is_typed(message.encoding)
    if declared is None or not ours:
        return to_jsonable(message.payload, message.encoding)
    return msgspec.to_builtins(codec.decode(declared.type, message.payload, message.encoding))


def field_of(value: Any, path: str) -> Any:
    """Return a message's field `position.z`, `position/z` or `values.0`; raise NoField."""
    within, left = "", path.split(".")[::-1]
    while left:
        part = left.pop()
        if isinstance(value, dict) and part in value:
            value = value[part]
        elif isinstance(value, list) and part.isdecimal() and int(part) < len(value):
            value = value[int(part)]
        elif "/" in part:
            # ROS's form; a foreign message may have a slash in the name of a field.
            left += part.split("/")[::-1]
            continue
        elif part:
            where = f"in {within or 'the message'} there is: {_contents(value)}"
            raise NoField(f"the message has no field {path}", where)
        within = f"{within}.{part}".strip(".")
    return value


def _contents(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(value) or "an empty table"
    if isinstance(value, list):
        return f"a list of {len(value)}" + (", counted from 0" if value else "")
    return "no fields"


def echo(
    options: Options,
    topic: Annotated[str, Arg("A topic, or any Zenoh key or key expression.", complete="topic")],
    count: Annotated[int | None, Option("End after so many messages.", ("-n",), min=1)] = None,
    once: Annotated[bool, Option("End after one message.", ("-1", "--once"))] = False,
    field: Annotated[str, Option("Show one field, e.g. position.z or values.0.")] = "",
) -> None:
    """Print messages as they come; end when none comes within the timeout.

    For an expression, e.g. uav/**, each message follows its key, and with --json it is
    {"key": ..., "value": ...}. A field may follow its topic, e.g. pose/position/z.

    Example: quadctl topic echo sensors/pressure -n 3
    """
    if once and (count or 1) > 1:
        raise UsageError("--once does not go with -n", "leave one of them out")
    count = 1 if once else count
    name, path = split(topic)
    options = about_topic(options, name)
    key = checked_key(topic, options.vehicle)
    with ExitStack() as held:
        client = held.enter_context(context.connect(options))
        if path and _is_field(client, key, name):
            key = checked_key(name, options.vehicle)
            field = f"{path}.{field}".rstrip(".")
        key = live_key(client, key)
        echoed = _Echo(options, held, client, key, field)
        seen = 0
        while count is None or seen < count:
            message, value = echoed.next()
            if options.json:
                output.document({"key": message.key, "value": value} if "*" in key else value)
            else:
                if "*" in key:
                    output.line(f"key: {message.key}")
                output.fields(value)
                if not field:
                    output.line("---")
            seen += 1


def _is_field(client: Client, key: str, topic: str) -> bool:
    """Return whether a key means a field of the vehicle's topic, and not a user's own topic."""
    ours = checked_key(topic, client.vehicle).startswith(f"{client.vehicle}/")
    return ours and all(offer.key != key for offer in client.endpoints("@pub", "@sub"))


_SIGNAL = 0.1
"""Seconds in which a process that is continued learns of it; its wait may have ended just before."""


class _Echo:
    """Messages of a key that can be shown; each kind of other message is noted once.

    `held` has the client; a command that was stopped replaces it, as the hub has given it up.
    """

    def __init__(
        self, options: Options, held: ExitStack, client: Client, key: str, field: str
    ) -> None:
        self._options, self._held, self._key, self._field = options, held, key, field
        self._client, self._stream = client, client.listen(key, held=True)
        self._kinds: set[tuple[str, type[Invalid]]] = set()
        self._received = self._continued = False
        if sys.platform != "win32":
            signal.signal(signal.SIGCONT, self._on_continue)

    def next(self) -> tuple[RawMessage, Any]:
        """Return the next message and its value to show; raise Client.silent's error."""
        deadline = time.monotonic() + self._client.timeout
        unread: Invalid | None = None
        # Checked after each message, too: a flood of unreadable ones must not delay the timeout.
        while (now := time.monotonic()) <= deadline:
            message = self._stream.next(deadline - now)
            if message is None:
                time.sleep(_SIGNAL)
            if self._continued:
                deadline = self._reopen()
            if message is None:
                continue
            self._received = True
            try:
                value = shown(message, self._key, self._client.vehicle)
                return message, field_of(value, self._field)
            except Invalid as problem:
                if isinstance(problem, NoField) and "*" not in self._key:
                    raise
                unread = self._note(message.key, problem)
        raise self._client.silent(self._key, unread, more=self._received)

    def _on_continue(self, _number: int, _frame: Any) -> None:
        self._continued = True

    def _reopen(self) -> float:
        """Connect again, after a stop, and return the new deadline."""
        self._continued = False
        output.note("this command was stopped: messages of that time may be missing")
        self._held.close()
        self._client = self._held.enter_context(context.connect(self._options))
        self._stream = self._client.listen(self._key, held=True)
        return time.monotonic() + self._client.timeout

    def _note(self, key: str, problem: Invalid) -> Invalid:
        of = key if "*" in self._key else self._key
        error, kind = unreadable(of, problem), (of, type(problem))
        if kind not in self._kinds:
            self._kinds.add(kind)
            output.note(f"skipped a message on {error.message}")
        return error
