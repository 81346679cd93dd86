"""Reader of recordings, also truncated ones, and their summary."""

import os
import struct
import zlib
from collections.abc import Callable, Collection, Iterator
from io import SEEK_CUR, SEEK_END, BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple, TypeVar

import lz4.frame
import msgspec
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC
from msgspec import Struct

from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.nesting import is_too_deep
from quadctl.services.runtime.recording import mcap_format, writer

_LARGEST = 1 << 28
"""Bytes of the largest chunk that is unpacked, and of all schemas and channels together.

A chunk of our recorder has 4 MiB and at most one message more. A bomb of 1 kB may name any size.
"""
_CONTENT: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
}
"""Records of a recording, beside its messages; the index repeats what these say."""
_BODY = {*_CONTENT, Opcode.CHUNK, Opcode.MESSAGE, Opcode.FOOTER}
"""Records up to the index."""
_INDEX: dict[int, Any] = {
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
}
"""Records of the index, and those that it names."""
_HEAD, _MESSAGE = struct.Struct("<BQ"), struct.Struct("<HIQQ")
_FOOTER = 9 + 20 + len(MCAP0_MAGIC)
"""Bytes of the end of a complete recording, from its footer on."""
_TORN = (McapError, zstandard.ZstdError, struct.error, ValueError, LookupError, RuntimeError)
"""Errors for missing or damaged bytes."""


M = TypeVar("M", bound=Struct)


class Recorded(NamedTuple):
    """A message of a recording; it was received `at` a Unix time, ns."""

    channel: Channel
    schema: Schema | None
    at: int
    published: int
    data: bytes
    sequence: int = 0

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
        """Return its payload on the bus; raises Invalid if the data are damaged."""
        packed = self.channel.metadata.get(writer.PACKED) == "yes"
        try:
            return mcap_format.restored(self.data, packed=packed)
        except (msgspec.MsgspecError, ValueError, RecursionError) as error:
            raise Invalid(
                f"a message on {self.key!r} is damaged: {error}", "`quadctl bag check` shows all"
            ) from error

    def decoded(self, type_: type[M]) -> M:
        """Return it as one of our types; raises Invalid if it is none or damaged."""
        if self.channel.message_encoding != mcap_format.JSON:
            return codec.decode(type_, self.payload, self.encoding)
        codec.check_schema(type_, self.encoding)
        try:
            return msgspec.json.decode(self.data, type=type_)
        except (msgspec.MsgspecError, ValueError, RecursionError) as error:
            raise Invalid(f"not a valid {type_.__name__}: {error}") from error

    @property
    def value(self) -> Any:
        """Return its fields as plain data, None if they cannot be read."""
        try:
            if self.channel.message_encoding == mcap_format.JSON:
                value = msgspec.json.decode(self.data)
            elif self.channel.message_encoding == mcap_format.MSGPACK:
                value = msgspec.msgpack.decode(self.data)
            else:
                return None
        except (msgspec.MsgspecError, ValueError, RecursionError):
            return None
        return None if is_too_deep(value) else value


Wanted = Callable[[Channel], bool]
"""Returns whether messages of a channel are wanted."""


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
        self._known: dict[int, tuple[Channel, Schema | None] | None] = {}
        """Channels of messages, with their schemas; None for one that is not wanted."""
        self._described = 0  # bytes of the schemas and channels held

    def messages(self, wanted: Wanted = lambda _channel: True) -> Iterator[Recorded]:
        """Yield the messages of wanted channels in the order received; raise as `records`."""
        for record in self.records(wanted):
            if isinstance(record, Recorded):
                yield record

    def records(
        self, wanted: Wanted = lambda _channel: True
    ) -> Iterator[Recorded | Header | Schema | Channel | Attachment | Metadata]:
        """Yield all records but the index, and of the messages those of wanted channels.

        Raises Invalid if it is not a recording, or unpacks to too much.
        """
        with opened(self.path) as file:
            magic = file.read(len(MCAP0_MAGIC))
            if not MCAP0_MAGIC.startswith(magic):
                raise Invalid(f"{self.path} is not a recording", "recordings are MCAP files")
            try:
                end = os.fstat(file.fileno()).st_size
                for opcode, record in _framed(file, end, _BODY):
                    if opcode == Opcode.FOOTER:
                        break
                    if opcode == Opcode.CHUNK:
                        yield from self._contents(_unpacked(_read(Chunk, record)), wanted)
                    else:
                        yield from self._contents(_HEAD.pack(opcode, len(record)) + record, wanted)
                    self.read_to = file.tell()
                if file.read(len(MCAP0_MAGIC) + 1) != MCAP0_MAGIC:
                    self.cut = "it ends in the middle"
            except _TORN as problem:
                self.cut = str(problem) or "it ends in the middle"
            except MemoryError as error:
                raise Invalid(f"{self.path} does not fit into memory", "free some") from error

    def _contents(self, data: bytes, wanted: Wanted) -> Iterator[Any]:
        """Yield the records in a chunk's data: an hour has a million, so without further calls."""
        begin, size, known = 0, len(data), self._known
        message, new = Opcode.MESSAGE.value, tuple.__new__
        while begin < size:
            opcode, length = _HEAD.unpack_from(data, begin)
            start = begin + _HEAD.size
            begin = end = start + length
            if end > size:
                raise ValueError("it ends in the middle")
            if opcode == message:
                number, sequence, at, published = _MESSAGE.unpack_from(data, start)
                if (start := start + _MESSAGE.size) > end:
                    raise ValueError("a message is too short")
                if number not in known:
                    channel = self._channels[number]  # a KeyError counts as torn
                    described = channel, self._schemas.get(channel.schema_id)
                    known[number] = described if wanted(channel) else None
                if (source := known[number]) is not None:
                    # Its own constructor would take a tenth of the whole time.
                    yield new(Recorded, (*source, at, published, data[start:end], sequence))
            elif kind := _CONTENT.get(opcode):
                record = _read(kind, data[start:end])
                self._learn(record)
                yield record

    def _learn(self, record: McapRecord) -> None:
        self._known.clear()
        match record:
            case Header():
                self.header = record
            case Schema():
                self._described += _size(record) - _size(self._schemas.get(record.id))
                self._schemas[record.id] = record
            case Channel():
                self._described += _size(record) - _size(self._channels.get(record.id))
                self._channels[record.id] = record
            case Metadata():
                self.notes[record.name] = record.metadata
        if self._described > _LARGEST:
            raise _too_large("all schemas and channels", self._described)


def _size(record: Schema | Channel | None) -> int:
    match record:
        case Schema():
            return len(record.name) + len(record.data)
        case Channel():
            return len(record.topic) + sum(len(k) + len(v) for k, v in record.metadata.items())
    return 0


def _framed(file: IO[bytes], end: int, opcodes: Collection[int]) -> Iterator[tuple[int, bytes]]:
    """Yield the records with these opcodes up to an offset: opcode and data."""
    while file.tell() < end:
        opcode, length = _HEAD.unpack(file.read(_HEAD.size))
        if length > end - file.tell():
            raise ValueError("it ends in the middle")
        if opcode in opcodes:
            yield opcode, file.read(length)
        else:
            file.seek(length, SEEK_CUR)


def _read(kind: Any, data: bytes) -> Any:
    """Read a record from its own data only.

    The library's reader believes the lengths inside a record, which may exceed the record.
    """
    return kind.read(ReadDataStream(BytesIO(data)))


def _index_of(file: IO[bytes], end: int) -> Iterator[McapRecord]:
    """Yield the records of the index up to an offset."""
    for opcode, data in _framed(file, end, _INDEX):
        yield _read(_INDEX[opcode], data)


def _unpacked(chunk: Chunk) -> bytes:
    """Return a chunk's data after a check of their size and CRC."""
    size, data = chunk.uncompressed_size, chunk.data
    if size > _LARGEST:
        raise _too_large("a chunk", size)
    if chunk.compression == "zstd":
        # The frame's own size would win over the one given.
        if zstandard.frame_content_size(data) not in {-1, size}:
            raise ValueError("a chunk has two sizes")
        data = zstandard.decompress(data, size)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)
    elif chunk.compression:
        raise ValueError(f"its compression {chunk.compression!r} is unknown")
    crc = chunk.uncompressed_crc
    if len(data) != size or (crc and crc != zlib.crc32(data)):
        raise ValueError("a chunk is damaged")
    return data


def _too_large(what: str, size: int) -> Invalid:
    return Invalid(
        f"{what} of the recording would unpack to {size / 1e6:.0f} MB",
        f"at most {_LARGEST / 1e6:.0f} MB are read: is the file from someone you trust?",
    )


def summary(path: Path) -> Summary | None:
    """Return the index at the end of a complete recording; None if the recording is truncated."""
    found = Summary()
    with opened(path) as file:
        try:
            size = file.seek(-_FOOTER, SEEK_END) + _FOOTER
            footer = next(_index_of(file, size))
            if not isinstance(footer, Footer) or not footer.summary_start:
                return None
            file.seek(footer.summary_start)
            for record in _index_of(file, size - _FOOTER):
                match record:
                    case Statistics():
                        found.statistics = record
                    case Schema():
                        found.schemas[record.id] = record
                    case Channel():
                        found.channels[record.id] = record
                    case ChunkIndex():
                        found.chunk_indexes.append(record)
                    case MetadataIndex():
                        found.metadata_indexes.append(record)
        except (*_TORN, OverflowError, OSError, StopIteration):
            # OSError: the file is shorter than the footer. StopIteration: it has another end.
            return None
    return found


def _notes(path: Path, index: Summary) -> dict[str, dict[str, str]] | None:
    """Return the recorder's notes that an index names; None if they are not there."""
    found: dict[str, dict[str, str]] = {}
    with opened(path) as file:
        left = os.fstat(file.fileno()).st_size
        for entry in index.metadata_indexes:
            # A note that is named again and again would be read as often.
            left -= entry.length
            try:
                file.seek(entry.offset)
                note = next(_index_of(file, entry.offset + entry.length)) if left >= 0 else None
            except (*_TORN, OverflowError, OSError, StopIteration):
                note = None
            if not isinstance(note, Metadata):
                return None
            found[note.name] = note.metadata
    return found


def opened(path: Path) -> IO[bytes]:
    """Open a file for reading; raises Invalid if it cannot be read."""
    try:
        return path.open("rb")
    except OSError as error:
        raise Invalid(
            f"{path} cannot be read: {error.strerror}", "`quadctl record` writes recordings"
        ) from error


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
    notes = None if found is None else _notes(path, found)
    if found is None or found.statistics is None or notes is None:
        return None
    stats, counts = found.statistics, found.statistics.channel_message_counts
    rows = [
        (channel, found.schemas.get(channel.schema_id), counts.get(number, 0))
        for number, channel in found.channels.items()
    ]
    return _facts(path, "", stats.message_start_time, stats.message_end_time, rows, notes)


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
