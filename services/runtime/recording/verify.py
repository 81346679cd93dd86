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
from quadctl.services.runtime.nesting import TOO_DEEP, is_too_deep
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
    bag, count, seen = Bag(path), 0, _Seen()
    for message in bag.messages():
        count += 1
        seen.add(message)
    faults = [*seen.faults, *seen.gaps()]
    if bag.cut:
        faults.insert(0, f"it is cut: {bag.cut}")
    more = [f"and {len(faults) - _MOST} more faults"] if len(faults) > _MOST else []
    return Checked(count, faults[:_MOST] + more)


class _Seen:
    """Messages seen so far: their faults, and the poses lost by their publisher's numbers."""

    def __init__(self) -> None:
        self.faults: list[str] = []
        self._at = 0
        self._poses: dict[str, Pose] = {}
        self._lost: Counter[str] = Counter()

    def add(self, message: Recorded) -> None:
        """Check one more message: an hour has a million, so in one function."""
        channel, schema, at, _, data, _ = message
        if at < self._at:
            older = (self._at - at) / 1e9
            self.faults.append(
                f"{channel.topic}: a message is {older:g} s older than the previous one"
            )
        else:
            self._at = at
        if channel.message_encoding != mcap_format.JSON:
            return
        if schema is None and channel.schema_id:
            self.faults.append(f"{channel.topic}: its schema is missing")
        name = schema.name if schema else ""
        found, problem = None, ""
        try:
            found = _DECODERS.get(name, _TABLE).decode(data)
            if type(found) is dict and is_too_deep(found):
                problem = TOO_DEEP
        except RecursionError:
            problem = TOO_DEEP
        except msgspec.MsgspecError as error:
            problem = str(error)
        if problem:
            told = f"{channel.topic}: a message is not a valid {name or 'table'}: {problem}"
            self.faults.append(told)
            return
        if type(found) is Pose:
            key = channel.topic
            last, self._poses[key] = self._poses.get(key), found
            if last and found.seq > last.seq + 1 and found.boot == last.boot:
                self._lost[key] += found.seq - last.seq - 1

    def gaps(self) -> Iterator[str]:
        """Yield where poses were lost; the numbers of slow ones have gaps anyway."""
        for key, lost in self._lost.items():
            if not key.endswith(f"/{POSE_SLOW.name}"):
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
