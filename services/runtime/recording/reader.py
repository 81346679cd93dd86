"""Reader of recordings, truncated ones too, and their summary."""

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple

import msgspec
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    Schema,
)
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC
from msgspec import Struct
from zstandard import ZstdError

from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.recording import mcap_format, writer

_TORN = (McapError, ZstdError, struct.error, ValueError, LookupError, RuntimeError, MemoryError)
"""What the library raises where bytes are missing, or are not what was written."""


class Recorded(NamedTuple):
    """A message of a recording: `at` that Unix time it came, ns."""

    channel: Channel
    schema: Schema | None
    at: int
    published: int
    data: bytes

    @property
    def key(self) -> str:
        """The key that it came on."""
        return self.channel.topic

    @property
    def encoding(self) -> str:
        """Its encoding on the bus."""
        return self.channel.metadata.get(writer.SAID, "")

    @property
    def derived(self) -> bool:
        """Whether it was never on the bus, but made of what was, for viewers."""
        return writer.DERIVED in self.channel.metadata

    @property
    def payload(self) -> bytes:
        """What it was on the bus."""
        packed = self.channel.metadata.get(writer.PACKED) == "yes"
        return mcap_format.restored(self.data, packed=packed)

    @property
    def value(self) -> Any:
        """Its fields as plain data, None where it has none that can be read."""
        try:
            if self.channel.message_encoding == mcap_format.JSON:
                return msgspec.json.decode(self.data)
            if self.channel.message_encoding == mcap_format.MSGPACK:
                return msgspec.msgpack.decode(self.data)
        except (msgspec.MsgspecError, ValueError, RecursionError):
            pass
        return None


class Bag:
    """A recording, read once from its beginning to its end, or to where it is cut.

    `cut` says, after that, why it ended before its index; it is empty where it is whole. `notes`
    are the facts that the recorder kept, `header` what the file says of its writer.
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
        """The messages in the order in which they came; raises Invalid where it is no recording."""
        for record in self.records():
            if isinstance(record, Message):
                channel = self._channels[record.channel_id]
                schema = self._schemas.get(channel.schema_id)
                yield Recorded(channel, schema, record.log_time, record.publish_time, record.data)

    def records(self) -> Iterator[McapRecord]:
        """All that was written, its index left out."""
        with opened(self.path) as file:
            magic = file.read(len(MCAP0_MAGIC))
            if not MCAP0_MAGIC.startswith(magic):
                raise Invalid(f"{self.path} is no recording", "recordings are MCAP files")
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
                self._channels[record.channel_id]  # one that is nowhere declared is torn, too
            case Metadata():
                self.notes[record.name] = record.metadata


def summary(path: Path) -> Summary | None:
    """The index that a whole recording ends with; None of one that is cut."""
    with opened(path) as file:
        try:
            return make_reader(file).get_summary()
        except (*_TORN, OSError):
            # OSError: it is shorter than what it would end with.
            return None


def notes(path: Path) -> dict[str, dict[str, str]]:
    """The facts that the recorder kept, of a whole recording."""
    with opened(path) as file:
        return {note.name: note.metadata for note in make_reader(file).iter_metadata()}


def opened(path: Path) -> IO[bytes]:
    """The file for reading; raises Invalid where it cannot be read."""
    try:
        return path.open("rb")
    except OSError as error:
        raise Invalid(
            f"{path} cannot be read: {error.strerror}", "`quadctl record` writes recordings"
        ) from error


def _parts(record: McapRecord) -> Iterator[McapRecord]:
    """A chunk's records once it is known to be whole, and of the others those that carry data."""
    if isinstance(record, Chunk):
        yield from breakup_chunk(record, validate_crc=True)
    elif isinstance(record, Header | Schema | Channel | Message | Metadata | Attachment | Footer):
        yield record


class KeyFacts(Struct, frozen=True):
    """What came on one key: of which type or encoding, how many, and how many a second."""

    key: str
    type: str
    encoding: str
    messages: int
    hz: float
    derived: bool


class BagFacts(Struct, frozen=True):
    """A recording as a whole.

    `begin` and `end` are Unix times, s; `cut` says why it is not whole, and is empty where it is.
    """

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
    """What a file holds; raises Invalid where it is no recording."""
    return _indexed(path) or _counted(path)


def _indexed(path: Path) -> BagFacts | None:
    found = summary(path)
    if found is None or found.statistics is None:
        return None
    said = found.statistics
    rows = [
        (channel, found.schemas.get(channel.schema_id), said.channel_message_counts.get(number, 0))
        for number, channel in found.channels.items()
    ]
    noted = notes(path)
    return _facts(path, "", said.message_start_time, said.message_end_time, rows, noted)


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
            channel.metadata.get(writer.SAID, channel.message_encoding),
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
