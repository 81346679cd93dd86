"""Check of a recording against its schemas, and repair of a cut or damaged one."""

import hashlib
import os
import stat
from collections import Counter
from collections.abc import Iterator
from itertools import chain, count
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import Writer

from quadctl.schemas.messages import Pose
from quadctl.schemas.topics import MESSAGES, POSE_SLOW
from quadctl.schemas.typed import json_decoder
from quadctl.services.runtime.errors import AlreadyServed, Invalid, QuadctlError
from quadctl.services.runtime.filelock import is_locked
from quadctl.services.runtime.nesting import TOO_DEEP, is_too_deep
from quadctl.services.runtime.recording import mcap_format
from quadctl.services.runtime.recording.reader import STILL_RECORDED, Bag, Recorded, missing
from quadctl.services.runtime.recording.writer import Outfile

_DECODERS: dict[str, Any] = {
    f"quadctl.{name}": json_decoder(type_) for name, type_ in MESSAGES.items()
}
_TABLE = json_decoder(dict[str, Any])
_MOST = 20
"""Faults that are listed; more would not help the reader."""


class Checked(NamedTuple):
    """Number of messages, their faults, one line each, and how many of an encoding are not checked.

    `repairable` says whether a repair would help.
    """

    messages: int
    faults: list[str]
    unchecked: dict[str, int]
    repairable: bool


def check(path: Path) -> Checked:
    """Check every message against its schema; raises Invalid if the file is not a recording."""
    bag, count, seen = Bag(path), 0, _Seen()
    for message in bag.messages():
        count += 1
        seen.add(message)
    faults = [*seen.faults, *seen.gaps()]
    if lost := missing(path, count):
        faults.insert(0, f"{lost} messages that its index counts cannot be read")
    if bag.problem:
        faults.insert(0, f"it is {bag.problem}")
    repairable = bool(bag.problem) and bag.cut != STILL_RECORDED
    more = [f"and {len(faults) - _MOST} more faults"] if len(faults) > _MOST else []
    return Checked(count, faults[:_MOST] + more, dict(seen.unchecked), repairable)


class _Seen:
    """Messages seen so far: their faults, and the poses lost by their publisher's numbers."""

    def __init__(self) -> None:
        self.faults: list[str] = []
        self.unchecked: Counter[str] = Counter()
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
            if channel.schema_id:
                self.unchecked[channel.message_encoding] += 1
            return
        if schema is None and channel.schema_id:
            self.faults.append(f"{channel.topic}: its schema is missing")
        name = schema.name if schema else ""
        found, problem = None, ""
        try:
            found = _DECODERS.get(name, _TABLE).decode(data)
            if type(found) is dict and is_too_deep(found, data):
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
    """Result of a repair: messages kept, bytes that cannot be read, and in which way it was not whole.

    `damaged` counts the places inside it that cannot be read; `original` is where the file went then.
    """

    messages: int
    dropped: int
    why: str
    damaged: int
    original: Path | None = None


def repair(source: Path, target: Path) -> Repaired:
    """Copy all that can be read of a recording into a new file, and read it again to compare.

    Raises Invalid if the source is not a recording, OSError if writing fails; without a target.
    """
    bag, messages, read = Bag(source), 0, hashlib.blake2b()
    records = bag.records()
    first = next(records, None)
    out = Outfile.create(target)
    try:
        mcap = Writer(out)  # type: ignore[arg-type] # all it calls is there
        mcap.start(bag.header.profile, bag.header.library or "quadctl")
        copy = _Copy(mcap)
        for record in chain([first] if first is not None else [], records):
            messages += isinstance(record, Recorded)
            copy.add(record)
            _feed(read, record)
        mcap.finish()
        out.flush()
        again = hashlib.blake2b()
        for record in Bag(target).records():
            _feed(again, record)
        if again.digest() != read.digest():
            raise QuadctlError(f"{target} reads back differently", "is its disk sound?")  # noqa: TRY301
    except BaseException:
        target.unlink(missing_ok=True)
        raise
    finally:
        out.close()
    return Repaired(messages, bag.unread, bag.problem, bag.damaged)


def repair_in_place(path: Path) -> Repaired:
    """Repair a recording under its own name, with its links, owner and mode.

    What was damaged inside is kept beside it: other tools may read more of it. Raises as `repair`,
    AlreadyServed while it is recorded, and Invalid if the new file cannot take its place.
    """
    file = path.resolve()
    if is_locked(file):
        raise AlreadyServed(f"{path} is still being recorded", "end its recorder first: Ctrl-C")
    fresh = file.with_name(f".{file.name}.{os.getpid()}")
    done = repair(file, fresh)
    try:
        if not done.why:
            return done
        was = file.stat()
        if was.st_nlink > 1:
            raise Invalid(
                f"{path} has another name as well, a hard link, which would keep the faulty file",
                f"name another file: `quadctl bag repair {path} -o FILE`",
            )
        _give(fresh, was, path)
        original = _set_aside(file) if done.damaged else None
        fresh.replace(file)
    finally:
        fresh.unlink(missing_ok=True)
    return done._replace(original=original and path.with_name(original.name))


def _give(fresh: Path, was: os.stat_result, path: Path) -> None:
    """Give a new file the owner and the mode of the one that it replaces."""
    now = fresh.stat()
    try:
        if (now.st_uid, now.st_gid) != (was.st_uid, was.st_gid):
            os.chown(fresh, was.st_uid, was.st_gid)
        fresh.chmod(stat.S_IMODE(was.st_mode))
    except PermissionError as error:
        raise Invalid(
            f"{path} belongs to another user or group, which a new file of yours cannot",
            f"name another file: `quadctl bag repair {path} -o FILE`",
        ) from error


def _set_aside(file: Path) -> Path:
    """Give a file a second name beside it, and return that."""
    names = (f"{file.name}.damaged{f'-{n}' * bool(n)}" for n in count())
    aside = next(free for name in names if not (free := file.with_name(name)).exists())
    try:
        aside.hardlink_to(file)
    except OSError:
        file.rename(aside)  # a disk without hard links
    return aside


def _feed(digest: Any, record: object) -> None:
    """Add what a record holds to a digest."""
    match record:
        case Recorded():
            channel, schema, at, published, data, sequence = record
            about = (
                channel.topic,
                channel.message_encoding,
                channel.metadata,
                schema and schema.name,
            )
            digest.update(repr((*about, at, published, sequence, len(data))).encode())
            digest.update(data)
        case Metadata() | Attachment():
            digest.update(repr(record).encode())


class _Copy:
    """Copy of records to another file, which numbers schemas and channels differently."""

    def __init__(self, mcap: Writer) -> None:
        self._mcap = mcap
        self._schemas, self._channels = {0: 0}, dict[int, int]()

    def add(self, record: object) -> None:
        """Write a record, but each schema and channel only once."""
        mcap = self._mcap
        match record:
            case Schema():
                self._schema(record)
            case Channel() if record.schema_id in self._schemas:
                self._channel(record)
            case Recorded():
                # Its own records may be among what is damaged.
                if record.schema is not None:
                    self._schema(record.schema)
                number, at, published = self._channel(record.channel), record.at, record.published
                mcap.add_message(number, at, record.data, published, record.sequence)
            case Metadata():
                mcap.add_metadata(record.name, record.metadata)
            case Attachment():
                mcap.add_attachment(
                    record.create_time, record.log_time, record.name, record.media_type, record.data
                )

    def _schema(self, schema: Schema) -> None:
        if schema.id not in self._schemas:
            number = self._mcap.register_schema(schema.name, schema.encoding, schema.data)
            self._schemas[schema.id] = number

    def _channel(self, channel: Channel) -> int:
        if channel.id not in self._channels:
            schema = self._schemas.get(channel.schema_id, 0)
            self._channels[channel.id] = self._mcap.register_channel(
                channel.topic, channel.message_encoding, schema, channel.metadata
            )
        return self._channels[channel.id]
