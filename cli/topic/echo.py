"""`topic echo`: prints messages as they come."""

import time
from typing import Annotated, Any

from cli import bus, output
from cli.declare import Arg, Opt
from cli.names import checked_key
from cli.options import Options
from cli.topic.behind import split
from cli.topic.shown import NoField, field_of, shown
from cli.which import about_topic
from services.runtime.bus.client import Client
from services.runtime.bus.codec import unreadable
from services.runtime.bus.streams import Message
from services.runtime.errors import Invalid, UsageError


def echo(
    options: Options,
    topic: Annotated[str, Arg("A topic, or any Zenoh key or key expression.", complete="topic")],
    count: Annotated[int | None, Opt("End after so many messages.", ("-n",), min=1)] = None,
    once: Annotated[bool, Opt("End after one message.", ("-1", "--once"))] = False,
    field: Annotated[str, Opt("Show one field of each message, as position.z or values.0.")] = "",
) -> None:
    """Print messages as they come; ends when none comes within the timeout.

    Of an expression, as uav/**, each message is preceded by its key, and with --json is
    {"key": ..., "value": ...}. A field may stand behind its topic, as pose/position/z.

    Example: quadctl topic echo sensors/pressure -n 3
    """
    if once and (count or 1) > 1:
        raise UsageError("--once does not go with -n", "leave one of them out")
    count = 1 if once else count
    name, behind = split(topic)
    options = about_topic(options, name)
    key = checked_key(topic, options.vehicle)
    with bus.connect(options) as client:
        if behind and _is_field(client, key, name):
            key = checked_key(name, options.vehicle)
            field = f"{behind}.{field}".rstrip(".")
        echoed = _Echo(client, key, field)
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
    """Whether a key means a field behind a topic of the vehicle: it may be somebody's own topic."""
    ours = checked_key(topic, client.vehicle).startswith(f"{client.vehicle}/")
    return ours and all(offer.key != key for offer in client.offers())


class _Echo:
    """The messages of a key that can be shown; of the others it is said, once a kind, why not."""

    def __init__(self, client: Client, key: str, field: str) -> None:
        self._client, self._key, self._field = client, key, field
        self._stream = client.listen(key, held=True)
        self._kinds: set[tuple[str, type[Invalid]]] = set()
        self._heard = False

    def next(self) -> tuple[Message, Any]:
        """The next message with what there is to show of it; raises what Client.silent says."""
        deadline = time.monotonic() + self._client.timeout
        unread: Invalid | None = None
        while (message := self._stream.next(deadline - time.monotonic())) is not None:
            self._heard = True
            try:
                value = shown(message, self._key, self._client.vehicle)
                return message, field_of(value, self._field)
            except NoField as problem:
                if "*" not in self._key:
                    raise
                unread = self._told(message.key, problem)
            except Invalid as problem:
                unread = self._told(message.key, problem)
            # A flood of nonsense must not keep the command from its timeout.
            if time.monotonic() > deadline:
                break
        raise self._client.silent(self._key, unread, more=self._heard)

    def _told(self, key: str, problem: Invalid) -> Invalid:
        of = key if "*" in self._key else self._key
        said, kind = unreadable(of, problem), (of, type(problem))
        if kind not in self._kinds:
            self._kinds.add(kind)
            output.note(f"passed over a message on {said.message}")
        return said
