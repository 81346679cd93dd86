"""Reader of recordings, also truncated ones, and their summary."""

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple

import msgspec
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC
from msgspec import Struct
from zstandard import ZstdError

from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.recording import mcap_format, writer

_TORN = (McapError, ZstdError, struct.error, ValueError, LookupError, RuntimeError, MemoryError)
"""Errors that the library raises for missing or damaged bytes."""


class Recorded(NamedTuple):
    """A message of a recording; it was received `at` a Unix time, ns."""

    channel: Channel
    schema: Schema | None
    at: int
    published: int
    data: bytes

    @property
    def key(self) -> str:
        """Return the key that it was published on."""
        return self.channel.topic

    @property
    def encoding(self) -> str:
        """Return its encoding on the bus."""
        return self.channel.metadata.get(writer.ENCODING, "")

    @property
    def derived(self) -> bool:
        """Return whether the recorder made it for viewers; it was never on the bus."""
        return writer.DERIVED in self.channel.metadata

    @property
    def payload(self) -> bytes:
        """Return its payload on the bus."""
        packed = self.channel.metadata.get(writer.PACKED) == "yes"
        return mcap_format.restored(self.data, packed=packed)

    @property
    def value(self) -> Any:
        """Return its fields as plain data, None if they cannot be read."""
        try:
            if self.channel.message_encoding == mcap_format.JSON:
                return msgspec.json.decode(self.data)
            if self.channel.message_encoding == mcap_format.MSGPACK:
                return msgspec.msgpack.decode(self.data)
        except (msgspec.MsgspecError, ValueError, RecursionError):
            pass
        return None


class Bag:
    """A recording, read once from its beginning to its end, or to the last whole record.

    `cut` is then the reason why it ends before its index, or empty if it is complete. `notes` are
    the recorder's notes; `header` names the program that wrote the file.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.cut = path, ""
        self.header = Header("", "")
        self.notes: dict[str, dict[str, str]] = {}
        self.read_to = 0
        """Bytes up to the end of the last whole record."""
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}

    def messages(self) -> Iterator[Recorded]:
        """Yield the messages in the order received; raises Invalid if it is not a recording."""
        for record in self.records():
            if isinstance(record, Message):
                channel = self._channels[record.channel_id]
                schema = self._schemas.get(channel.schema_id)
                yield Recorded(channel, schema, record.log_time, record.publish_time, record.data)

    def records(self) -> Iterator[McapRecord]:
        """Yield all records but the index."""
        with opened(self.path) as file:
            magic = file.read(len(MCAP0_MAGIC))
            if not MCAP0_MAGIC.startswith(magic):
                raise Invalid(f"{self.path} is not a recording", "recordings are MCAP files")
            size = os.fstat(file.fileno()).st_size
            reader = StreamReader(file, skip_magic=True, emit_chunks=True, record_size_limit=size)
            try:
                for record in reader.records:
                    for part in _parts(record):
                        self._learn(part)
                        yield part
                    self.read_to = file.tell()
            except _TORN as problem:
                self.cut = str(problem) or "it ends in the middle"

    def _learn(self, record: McapRecord) -> None:
        match record:
            case Header():
                self.header = record
            case Schema():
                self._schemas[record.id] = record
            case Channel():
                self._channels[record.id] = record
            case Message():
                self._channels[record.channel_id]  # a KeyError counts as torn
            case Metadata():
                self.notes[record.name] = record.metadata


def summary(path: Path) -> Summary | None:
    """Return the index at the end of a complete recording; None if the recording is truncated."""
    with opened(path) as file:
        try:
            return make_reader(file).get_summary()
        except (*_TORN, OSError):
            # OSError: the file is shorter than the footer.
            return None


def notes(path: Path) -> dict[str, dict[str, str]]:
    """Return the recorder's notes of a complete recording."""
    with opened(path) as file:
        return {note.name: note.metadata for note in make_reader(file).iter_metadata()}


def opened(path: Path) -> IO[bytes]:
    """Open a file for reading; raises Invalid if it cannot be read."""
    try:
        return path.open("rb")
    except OSError as error:
        raise Invalid(
            f"{path} cannot be read: {error.strerror}", "`quadctl record` writes recordings"
        ) from error


def _parts(record: McapRecord) -> Iterator[McapRecord]:
    """Yield a chunk's records after a check of its CRC; outside chunks, the records with data."""
    if isinstance(record, Chunk):
        yield from breakup_chunk(record, validate_crc=True)
    elif isinstance(record, Header | Schema | Channel | Message | Metadata | Attachment):
        yield record


class KeyFacts(Struct, frozen=True):
    """Messages of one key: their type, encoding, number and rate."""

    key: str
    type: str
    encoding: str
    messages: int
    hz: float
    derived: bool


class BagFacts(Struct, frozen=True):
    """Summary of a recording: `begin` and `end` are Unix times (s), `cut` why it is truncated."""

    file: str
    bytes: int
    cut: str
    begin: float
    end: float
    seconds: float
    messages: int
    keys: list[KeyFacts]
    notes: dict[str, dict[str, str]]


def facts(path: Path) -> BagFacts:
    """Return the summary of a file; raises Invalid if it is not a recording."""
    return _indexed(path) or _counted(path)


def _indexed(path: Path) -> BagFacts | None:
    found = summary(path)
    if found is None or found.statistics is None:
        return None
    stats, counts = found.statistics, found.statistics.channel_message_counts
    rows = [
        (channel, found.schemas.get(channel.schema_id), counts.get(number, 0))
        for number, channel in found.channels.items()
    ]
    return _facts(path, "", stats.message_start_time, stats.message_end_time, rows, notes(path))


def _counted(path: Path) -> BagFacts:
    bag, counts = Bag(path), dict[int, int]()
    rows: dict[int, tuple[Channel, Schema | None]] = {}
    begin = end = 0
    for message in bag.messages():
        number = message.channel.id
        rows[number] = (message.channel, message.schema)
        counts[number] = counts.get(number, 0) + 1
        begin, end = min(begin or message.at, message.at), max(end, message.at)
    counted = [(channel, schema, counts[number]) for number, (channel, schema) in rows.items()]
    return _facts(path, bag.cut, begin, end, counted, bag.notes)


def _facts(
    path: Path,
    cut: str,
    begin: int,
    end: int,
    rows: list[tuple[Channel, Schema | None, int]],
    notes: dict[str, dict[str, str]],
) -> BagFacts:
    seconds = (end - begin) / 1e9
    keys = [
        KeyFacts(
            channel.topic,
            schema.name.removeprefix("quadctl.") if schema else "",
            channel.metadata.get(writer.ENCODING, channel.message_encoding),
            count,
            (count - 1) / seconds if seconds and count > 1 else 0.0,
            writer.DERIVED in channel.metadata,
        )
        for channel, schema, count in rows
    ]
    keys.sort(key=lambda each: (each.derived, each.key))
    messages = sum(each.messages for each in keys if not each.derived)
    size = path.stat().st_size
    return BagFacts(str(path), size, cut, begin / 1e9, end / 1e9, seconds, messages, keys, notes)
