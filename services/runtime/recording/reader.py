"""Reader of recordings, also cut or damaged ones, and their summary."""

import os
import struct
import zlib
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple, TypeVar

import lz4.frame
import msgspec
import zstandard
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Metadata, Schema
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC
from msgspec import Struct

from quadctl.schemas.typed import from_json
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.filelock import is_locked
from quadctl.services.runtime.nesting import is_too_deep
from quadctl.services.runtime.recording import mcap_format, writer
from quadctl.services.runtime.recording.framing import (
    CHECKED,
    ENDS,
    HEAD,
    TORN,
    has_index,
    has_magic,
    next_record,
    opened,
    parsed,
    record_at,
    summary,
)

STILL_RECORDED = "it is still being recorded"
_LARGEST = 1 << 28
"""Bytes of the largest chunk that is unpacked, and of all schemas and channels together.

A chunk of our recorder has 4 MiB and at most one message more. A bomb of 1 kB may name any size.
"""
_IN_ALL, _RATIO = 1 << 28, 100
"""Bytes that a recording may unpack to, and how many more for each byte of the file.

Flights unpack to 3 to 20 times their size.
"""
_MESSAGE = struct.Struct("<HIQQ")
_CONTENT: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
}
"""Records of a recording, beside its messages; the index repeats what these say."""


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
            return from_json(self.data, type_)
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
    """A recording, read once from its beginning to its end, past all that is damaged.

    `cut` is then the reason why it ends before its index, or empty if it is complete. `damaged`
    counts the places that could not be read, `unread` is their bytes, and `first` the reason at the
    first one. `notes` are the recorder's notes; `header` names the program that wrote the file.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.cut, self.first = path, "", ""
        self.damaged = self.unread = 0
        self.header = Header("", "")
        self.notes: dict[str, dict[str, str]] = {}
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._known: dict[int, tuple[Channel, Schema | None] | None] = {}
        """Channels of messages, with their schemas; None for one that is not wanted."""
        self._index: Summary | None = None
        self._strange = set[int]()  # numbers of channels that nothing describes
        self._described = 0  # bytes of the schemas and channels held
        self._unpacked = 0  # bytes of all chunks so far
        self._place = 0  # offset of the record that is being read

    @property
    def problem(self) -> str:
        """Return in which way it is not whole, as words after `it is`; empty if it is."""
        places = f"{self.damaged} places" if self.damaged > 1 else "one place"
        harm = f"damaged in {places}, where {self.unread} bytes cannot be read, {self.first}"
        return "; ".join([f"cut: {self.cut}"] * bool(self.cut) + [harm] * bool(self.damaged))

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
            end = os.fstat(file.fileno()).st_size
            self._check_beginning(file, end)
            place, whole = min(len(MCAP0_MAGIC), end), False
            while place < end and not whole:
                if (found := record_at(file, place, end)) is not None:
                    opcode, after = found
                    whole = opcode in ENDS
                    if not whole:
                        after = yield from self._read(file, opcode, place, after, end, wanted)
                elif (behind := next_record(file, place + 1, end)) is not None:
                    after = behind
                    self._damage(place, after, "no record begins there")
                else:
                    break
                place = after
            if whole:
                self._check_index(file, place, end)
            else:
                self.unread += end - place
            if not whole or not has_magic(file, end):
                used = is_locked(self.path)
                self.cut = STILL_RECORDED if used else "it ends in the middle"

    def _read(
        self, file: IO[bytes], opcode: int, place: int, after: int, end: int, wanted: Wanted
    ) -> Generator[Any, None, int]:
        """Yield what is in a record; return the offset of the next one."""
        if opcode not in CHECKED and after < end and not record_at(file, after, end):
            # Nothing else shows that a length is wrong.
            found = next_record(file, place + 1, end)
            if found is not None and found < after:
                self._damage(place, found, "a record is longer than the place for it")
                return found
        self._place = place
        file.seek(place)
        try:
            if opcode == Opcode.CHUNK:
                if file.read(1)[0] != opcode:
                    self._damage(place, place, "a chunk is marked as something else")
                file.seek(place + HEAD.size)
                data = self._unpack(parsed(Chunk, file.read(after - place - HEAD.size)), end)
                yield from self._contents(data, wanted)
            elif opcode in _CONTENT or opcode == Opcode.MESSAGE:
                yield from self._contents(file.read(after - place), wanted)
        except TORN as problem:
            self._damage(place, after, str(problem) or "its record is damaged")
        except MemoryError as error:
            raise Invalid(f"{self.path} does not fit into memory", "free some") from error
        return after

    def _contents(self, data: bytes, wanted: Wanted) -> Iterator[Any]:
        """Yield the records in a chunk's data: an hour has a million, so without further calls."""
        begin, size, known = 0, len(data), self._known
        message, new = Opcode.MESSAGE.value, tuple.__new__
        while begin < size:
            opcode, length = HEAD.unpack_from(data, begin)
            start = begin + HEAD.size
            begin = end = start + length
            if end > size:
                raise ValueError("a record is longer than its chunk")
            if opcode == message:
                number, sequence, at, published = _MESSAGE.unpack_from(data, start)
                if (start := start + _MESSAGE.size) > end:
                    raise ValueError("a message is too short")
                if number not in known:
                    known[number] = self._source(number, wanted)
                if (source := known[number]) is not None:
                    # Its own constructor would take a tenth of the whole time.
                    yield new(Recorded, (*source, at, published, data[start:end], sequence))
            elif kind := _CONTENT.get(opcode):
                record = parsed(kind, data[start:end])
                self._learn(record)
                yield record
            else:
                raise ValueError(f"a chunk holds a record of kind {opcode}")

    def _source(self, number: int, wanted: Wanted) -> tuple[Channel, Schema | None] | None:
        """Return the channel of a message and its schema, None if it is unknown or not wanted.

        The index describes those again that were lost with a damaged chunk.
        """
        channel = self._channels.get(number) or self._indexed.channels.get(number)
        if channel is None:
            if number not in self._strange:
                self._strange.add(number)
                self._damage(self._place, self._place, f"nothing describes channel {number}")
            return None
        if not wanted(channel):
            return None
        schema = self._schemas.get(channel.schema_id)
        if schema is None and channel.schema_id:
            schema = self._indexed.schemas.get(channel.schema_id)
        return channel, schema

    @property
    def _indexed(self) -> Summary:
        if self._index is None:
            self._index = summary(self.path) or Summary()
        return self._index

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
            raise _too_large("all schemas and channels", self._described, _LARGEST)

    def _unpack(self, chunk: Chunk, end: int) -> bytes:
        """Return a chunk's data after a check of their size and CRC; `end` is the file's size."""
        size, data = chunk.uncompressed_size, chunk.data
        if _own_size(chunk) not in {None, size}:
            raise ValueError("a chunk has two sizes")
        if size > _LARGEST:
            raise _too_large("a chunk", size, _LARGEST)
        self._unpacked += size
        if self._unpacked > (most := _IN_ALL + _RATIO * end):
            raise _too_large("the chunks", self._unpacked, most)
        if chunk.compression == "zstd":
            data = zstandard.decompress(data, size)
        elif chunk.compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)
        elif chunk.compression:
            raise ValueError(f"a chunk's compression {chunk.compression!r} is unknown")
        crc = chunk.uncompressed_crc
        if len(data) != size or (crc and crc != zlib.crc32(data)):
            raise ValueError("a chunk is damaged")
        return data

    def _check_beginning(self, file: IO[bytes], end: int) -> None:
        """Note a damaged beginning; raise Invalid if the end is not that of a recording either."""
        magic = file.read(len(MCAP0_MAGIC))
        if MCAP0_MAGIC.startswith(magic):
            return
        if end < 2 * len(MCAP0_MAGIC) or not has_magic(file, end):
            raise Invalid(f"{self.path} is not a recording", "recordings are MCAP files")
        self._damage(0, len(MCAP0_MAGIC), "its beginning is damaged")

    def _check_index(self, file: IO[bytes], place: int, end: int) -> None:
        """Note an index that is damaged; nothing else has what it repeats, so no message is lost."""
        if has_magic(file, end) and has_index(file, end) and summary(self.path) is None:
            self._damage(place, place, "its index is damaged")

    def _damage(self, place: int, after: int, why: str) -> None:
        self.first = self.first or f"the first at byte {place}: {why}"
        self.damaged += 1
        self.unread += after - place


def _size(record: Schema | Channel | None) -> int:
    match record:
        case Schema():
            return len(record.name) + len(record.data)
        case Channel():
            return len(record.topic) + sum(len(k) + len(v) for k, v in record.metadata.items())
    return 0


def _own_size(chunk: Chunk) -> int | None:
    """Return the size that the packed data themselves give, None if they give none.

    It would win over the one of the chunk.
    """
    if chunk.compression == "zstd":
        size: int = zstandard.frame_content_size(chunk.data)
        return size if size >= 0 else None
    if chunk.compression == "lz4":
        return lz4.frame.get_frame_info(chunk.data)["content_size"] or None
    return None if chunk.compression else len(chunk.data)


def _too_large(what: str, size: int, most: int) -> Invalid:
    return Invalid(
        f"{what} of the recording would unpack to {size / 1e6:.0f} MB",
        f"at most {most / 1e6:.0f} MB are read: is the file from someone you trust?",
    )


class KeyFacts(Struct, frozen=True):
    """Messages of one key: their type, encoding, number and rate."""

    key: str
    type: str
    encoding: str
    messages: int
    hz: float
    derived: bool


class BagFacts(Struct, frozen=True):
    """Summary of a recording: `begin` and `end` are Unix times (s), `cut` why it is truncated.

    `damaged` counts the places that cannot be read, `unread_bytes` their bytes, `problem` names both
    in words. `missing` is the number of messages that the index counts in addition to those that
    can be read, None without an index.
    """

    file: str
    bytes: int
    cut: str
    damaged: int
    unread_bytes: int
    missing: int | None
    problem: str
    begin: float
    end: float
    seconds: float
    messages: int
    keys: list[KeyFacts]
    notes: dict[str, dict[str, str]]


def facts(path: Path) -> BagFacts:
    """Return the summary of a file; raises Invalid if it is not a recording.

    All of it is read, as an index does not know what has been damaged since.
    """
    bag, counts = Bag(path), dict[int, int]()
    rows: dict[int, tuple[Channel, Schema | None]] = {}
    begin = end = 0
    for message in bag.messages():
        number = message.channel.id
        rows[number] = (message.channel, message.schema)
        counts[number] = counts.get(number, 0) + 1
        begin, end = min(begin or message.at, message.at), max(end, message.at)
    seconds = (end - begin) / 1e9
    keys = [_key_facts(*row, counts[number], seconds) for number, row in rows.items()]
    keys.sort(key=lambda each: (each.derived, each.key))
    return BagFacts(
        str(path), path.stat().st_size, bag.cut, bag.damaged, bag.unread,
        missing(path, sum(counts.values())), bag.problem, begin / 1e9, end / 1e9, seconds,
        sum(each.messages for each in keys if not each.derived), keys, bag.notes,
    )  # fmt: skip


def missing(path: Path, read: int) -> int | None:
    """Return how many messages the index counts more than were `read`, None without an index."""
    found = summary(path)
    stats = None if found is None else found.statistics
    return None if stats is None else max(stats.message_count - read, 0)


def _key_facts(channel: Channel, schema: Schema | None, count: int, seconds: float) -> KeyFacts:
    encoding = channel.metadata.get(writer.ENCODING, channel.message_encoding)
    # A type that only its publisher knows has a name, but no schema.
    name = schema.name.removeprefix("quadctl.") if schema else codec.type_name(encoding)
    hz = (count - 1) / seconds if seconds and count > 1 else 0.0
    derived = writer.DERIVED in channel.metadata
    return KeyFacts(channel.topic, name, encoding, count, hz, derived)
