"""Check of a recording against its schemas, and repair of a truncated one."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import Writer

from quadctl.schemas.messages import Pose
from quadctl.schemas.topics import MESSAGES, POSE_SLOW
from quadctl.services.runtime.recording import mcap_format
from quadctl.services.runtime.recording.reader import Bag, Recorded
from quadctl.services.runtime.recording.writer import Outfile

_DECODERS: dict[str, msgspec.json.Decoder[Any]] = {
    f"quadctl.{name}": msgspec.json.Decoder(type_) for name, type_ in MESSAGES.items()
}
_TABLE = msgspec.json.Decoder(dict[str, Any])
_MOST = 20
"""Faults that are listed; more would not help the reader."""


class Checked(NamedTuple):
    """Number of messages checked, and their faults, one line each."""

    messages: int
    faults: list[str]


def check(path: Path) -> Checked:
    """Check every message against its schema; raises Invalid if the file is not a recording."""
    bag, count, last = Bag(path), 0, 0
    faults: list[str] = []
    gaps = _Gaps()
    for message in bag.messages():
        count += 1
        faults += _faults(message, last, gaps)
        last = max(last, message.at)
    faults += gaps.faults()
    if bag.cut:
        faults.insert(0, f"it is cut: {bag.cut}")
    more = [f"and {len(faults) - _MOST} more faults"] if len(faults) > _MOST else []
    return Checked(count, faults[:_MOST] + more)


def _faults(message: Recorded, last: int, gaps: "_Gaps") -> Iterator[str]:
    if message.at < last:
        older = (last - message.at) / 1e9
        yield f"{message.key}: a message is {older:g} s older than the previous one"
    if message.channel.message_encoding != mcap_format.JSON:
        return
    if message.schema is None and message.channel.schema_id:
        yield f"{message.key}: its schema is missing"
    name = message.schema.name if message.schema else ""
    try:
        found = _DECODERS.get(name, _TABLE).decode(message.data)
    except (msgspec.MsgspecError, RecursionError) as error:
        yield f"{message.key}: a message is not a valid {name or 'table'}: {error}"
    else:
        if isinstance(found, Pose):
            gaps.see(message.key, found)


class _Gaps:
    """Count of lost poses, from gaps in their publisher's sequence numbers."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[str, int]] = {}
        self._lost: Counter[str] = Counter()

    def see(self, key: str, pose: Pose) -> None:
        if key.endswith(f"/{POSE_SLOW.name}"):
            return  # their numbers have gaps
        boot, seq = self._last.get(key, ("", -1))
        if pose.boot == boot and pose.seq > seq + 1:
            self._lost[key] += pose.seq - seq - 1
        self._last[key] = (pose.boot, pose.seq)

    def faults(self) -> Iterator[str]:
        for key, lost in self._lost.items():
            yield f"{key}: {lost} messages are missing"


class Repaired(NamedTuple):
    """Result of a repair: messages kept, bytes dropped after the last whole record, and why."""

    messages: int
    dropped: int
    why: str


def repair(source: Path, target: Path) -> Repaired:
    """Copy all whole records of a recording into a new file.

    Raises Invalid if the source is not a recording, OSError if writing fails; without a target.
    """
    bag, messages = Bag(source), 0
    records = bag.records()
    first = next(records, None)
    out = Outfile.create(target)
    try:
        mcap = Writer(out)  # type: ignore[arg-type] # all it calls is there
        mcap.start(bag.header.profile, bag.header.library or "quadctl")
        copy = _Copy(mcap)
        if first is not None:
            copy.add(first)
        for record in records:
            messages += isinstance(record, Recorded)
            copy.add(record)
        mcap.finish()
        out.flush()
    except BaseException:
        target.unlink(missing_ok=True)
        raise
    finally:
        out.close()
    return Repaired(messages, source.stat().st_size - bag.read_to if bag.cut else 0, bag.cut)


class _Copy:
    """Copy of records to another file, which numbers schemas and channels differently."""

    def __init__(self, mcap: Writer) -> None:
        self._mcap = mcap
        self._schemas, self._channels = {0: 0}, dict[int, int]()

    def add(self, record: object) -> None:
        """Write a record, but each schema and channel only once."""
        mcap = self._mcap
        match record:
            case Schema() if record.id not in self._schemas:
                number = mcap.register_schema(record.name, record.encoding, record.data)
                self._schemas[record.id] = number
            case Channel() if record.id not in self._channels:
                schema = self._schemas[record.schema_id]
                self._channels[record.id] = mcap.register_channel(
                    record.topic, record.message_encoding, schema, record.metadata
                )
            case Recorded():
                number = self._channels[record.channel.id]
                at, published = record.at, record.published
                mcap.add_message(number, at, record.data, published, record.sequence)
            case Metadata():
                mcap.add_metadata(record.name, record.metadata)
            case Attachment():
                mcap.add_attachment(
                    record.create_time, record.log_time, record.name, record.media_type, record.data
                )
