"""Records of an MCAP file by their places, also behind damaged bytes, and its index."""

import os
import re
import struct
import zlib
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC

from quadctl.services.runtime import files

_INDEX: dict[int, Any] = {
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.STATISTICS: Statistics,
}
"""Records of the index."""
HEAD = struct.Struct("<BQ")
"""Opcode and length of a record."""
_FOOTER = 9 + 20 + len(MCAP0_MAGIC)
"""Bytes of the end of a complete recording, from its footer on."""
_FOOT = struct.Struct("<QQI")
ENDS = {Opcode.DATA_END, Opcode.FOOTER}
"""Records after the last message."""
CHECKED = {Opcode.CHUNK, Opcode.MESSAGE_INDEX, *ENDS}
"""Records whose length stands in them once more, or is always the same."""
_LEAST = dict(enumerate((8, 20, 14, 12, 22, 40, 6, 60, 36, 36, 46, 8, 20, 17, 4), 1))
"""Bytes that a record of each opcode has at least."""
_A_HEAD = re.compile(rb"(?=[\x01-\x0f][\s\S]{5}\0\0\0)")
"""Place that may be the beginning of a record of less than 1 TiB."""
_WINDOW = 1 << 20
"""Bytes that are searched at a time."""
_IN_A_ROW = 3
"""Records that must follow one another, for a place behind damage to be the beginning of one."""
TORN = (McapError, zstandard.ZstdError, struct.error, ValueError, LookupError, RuntimeError)
"""Errors for missing or damaged bytes."""


def record_at(file: IO[bytes], place: int, end: int) -> tuple[int, int] | None:
    """Return opcode and end of the record at an offset; None if none can begin there.

    A chunk is told from its own lengths, whatever its opcode: a flipped bit in that must not lose it.
    """
    file.seek(place)
    head = file.read(HEAD.size + 32)
    if len(head) < HEAD.size:
        return None
    opcode, length = HEAD.unpack_from(head)
    after: int = place + HEAD.size + length
    if after > end:
        return None
    if length >= _LEAST[Opcode.CHUNK]:
        name = int.from_bytes(head[-4:], "little")
        file.seek(place + len(head) + name)
        if name + 40 + int.from_bytes(file.read(8), "little") == length:
            return Opcode.CHUNK, after
    inside = 6 + int.from_bytes(head[HEAD.size + 2 : HEAD.size + 6], "little")
    wrong = (
        not opcode
        or opcode == Opcode.CHUNK
        or length < _LEAST.get(opcode, 0)
        or (opcode in ENDS and length != _LEAST[opcode])
        or (opcode == Opcode.MESSAGE_INDEX and length != inside)
    )
    return None if wrong else (opcode, after)


def next_record(file: IO[bytes], start: int, end: int) -> int | None:
    """Return the offset of the first record from an offset on, None if there is none."""
    for begin in range(start, end, _WINDOW):
        file.seek(begin)
        window = file.read(_WINDOW + HEAD.size - 1)
        for found in _A_HEAD.finditer(window):
            if _follow(file, begin + found.start(), end):
                return begin + found.start()
    return None


def _follow(file: IO[bytes], place: int, end: int) -> bool:
    """Return whether a chunk, or several records in a row or up to the end, begin at an offset."""
    for _ in range(_IN_A_ROW):
        found = record_at(file, place, end)
        if found is None or found[0] not in _LEAST:
            return False
        opcode, place = found
        if opcode == Opcode.CHUNK or place >= end - len(MCAP0_MAGIC):
            return True
    return True


def parsed(kind: Any, data: bytes) -> Any:
    """Read a record from its own data only.

    The library's reader believes the lengths inside a record, which may exceed the record.
    """
    return kind.read(ReadDataStream(BytesIO(data)))


def summary(path: Path) -> Summary | None:
    """Return the index at the end of a recording; None if there is none, or it is damaged."""
    found = Summary()
    with opened(path) as file:
        end = os.fstat(file.fileno()).st_size
        footer = _footer(file, end)
        if footer is None or not 0 < footer.summary_start < end - _FOOTER:
            return None
        if footer.summary_crc and footer.summary_crc != _crc(file, footer.summary_start, end - 12):
            return None
        place = footer.summary_start
        try:
            while place < end - _FOOTER:
                if (at := record_at(file, place, end - _FOOTER)) is None:
                    return None
                opcode, after = at
                file.seek(place + HEAD.size)
                data = file.read(after - place - HEAD.size) if opcode in _INDEX else b""
                match parsed(_INDEX[opcode], data) if data else None:
                    case Statistics() as record:
                        found.statistics = record
                    case Schema() as record:
                        found.schemas[record.id] = record
                    case Channel() as record:
                        found.channels[record.id] = record
                    case ChunkIndex() as record:
                        found.chunk_indexes.append(record)
                place = after
        except TORN:
            return None
    return found


def has_index(file: IO[bytes], end: int) -> bool:
    """Return whether a file that ends as a recording should have an index."""
    return _footer(file, end) != Footer(0, 0, 0)


def _footer(file: IO[bytes], end: int) -> Footer | None:
    """Return the footer of a file that has one."""
    file.seek(max(end - _FOOTER, 0))
    data = file.read(_FOOTER)
    if len(data) < _FOOTER or HEAD.unpack_from(data) != (Opcode.FOOTER, 20):
        return None
    return Footer(*_FOOT.unpack_from(data, HEAD.size))


def _crc(file: IO[bytes], start: int, end: int) -> int:
    file.seek(start)
    crc = 0
    while start < end:
        data = file.read(min(_WINDOW, end - start))
        crc, start = zlib.crc32(data, crc), start + len(data)
    return crc


def has_magic(file: IO[bytes], end: int) -> bool:
    """Return whether a file ends as a complete recording does."""
    file.seek(max(end - len(MCAP0_MAGIC), 0))
    return file.read() == MCAP0_MAGIC


def opened(path: Path) -> IO[bytes]:
    """Open a file for reading; raises Invalid if it cannot be read."""
    try:
        return files.opened(path)
    except OSError as error:
        raise files.unreadable(path, error, "`quadctl record` writes recordings") from error
