"""Recordings and TOML files made to be huge, endless or malformed, as an opponent would make them."""

import struct
from collections.abc import Callable
from typing import NamedTuple

import lz4.frame
import msgspec
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import (
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from tests.support.bags import BEGAN

MAGIC = b"\x89MCAP0\r\n"
GIB = 1 << 30
_BLOCK = 1 << 17


def packed(*records: McapRecord) -> bytes:
    """Return the bytes of records."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


def channel(number: int = 1, key: str = "uav/pose", schema: int = 0) -> Channel:
    return Channel(number, key, "json", {"zenoh_encoding": "", "packed": "yes"}, schema)


def message(data: bytes, number: int = 1) -> Message:
    return Message(number, BEGAN, data, BEGAN, 0)


def chunk(data: bytes, size: int, compression: str = "zstd") -> Chunk:
    return Chunk(compression, data, BEGAN, BEGAN, 0, size)


def recording(*records: McapRecord | bytes, index: bytes = b"", start: int | None = None) -> bytes:
    """Return a recording; `start` is the offset that its footer names for the index."""
    body = MAGIC + packed(Header("", "bomb"))
    body += b"".join(r if isinstance(r, bytes) else packed(r) for r in records)
    body += packed(DataEnd(0))
    at = (len(body) if index else 0) if start is None else start
    return body + index + packed(Footer(at, 0, 0)) + MAGIC


def zeros(size: int) -> bytes:
    """Return zeros compressed by Zstandard, made without them: 4 bytes for each 128 KiB."""
    block = (_BLOCK << 3 | 1 << 1).to_bytes(3, "little") + b"\0"  # one byte, repeated
    return b"\x28\xb5\x2f\xfd\0\x38" + block * (size // _BLOCK) + b"\x01\0\0"


def block(data: bytes) -> Chunk:
    """Return a sound chunk."""
    return chunk(zstandard.compress(data), len(data))


_DEEP = b'{"a":' * 5000 + b"1" + b"}" * 5000
_NOTE = Metadata("note", {str(number): "y" * 100 for number in range(1000)})
_NOTE_AT = len(MAGIC + packed(Header("", "bomb")))
_SHORT = bytes([5]) + struct.pack("<QHI", 6, 1, 0)
"""Message that is shorter than its own fields."""
_OVERLONG = bytes([4]) + struct.pack("<QHHI", 8, 1, 0, 0xFFFFFFFF)
"""Channel with a text longer than the channel."""
_CALL = {
    "boot": "b", "stamp": 1.0, "service": "goto", "held": False, "request": {"x": "here"},
    "response": {"accepted": False}, "error": "",
}  # fmt: skip


def _pose_of(**fields: object) -> bytes:
    return packed(
        Schema(1, b"{}", "jsonschema", "quadctl.Pose"),
        channel(schema=1),
        message(msgspec.json.encode(fields)),
    )


def _indexed(*index: McapRecord) -> bytes:
    return packed(Statistics(0, 0, {}, 0, 0, 0, 0, 1, 0), *index)


class Bomb(NamedTuple):
    """Recording, and a text that `bag check` must print about it, if any."""

    data: bytes
    said: str = ""


_TABLE = b'{"a":1}'
BOMBS: dict[str, Callable[[], Bomb]] = {
    "8 GiB by zstd": lambda: Bomb(recording(chunk(zeros(8 * GIB), 8 * GIB)), "8590 MB"),
    "8 GiB named as 100 bytes": lambda: Bomb(recording(chunk(zeros(8 * GIB), 100)), "damaged"),
    "64 MiB by lz4 as 100 bytes": lambda: Bomb(recording(chunk(lz4.frame.compress(bytes(GIB // 16)), 100, "lz4")), "damaged"),
    "an endless claim": lambda: Bomb(recording(chunk(zstandard.compress(b"x"), 1 << 62)), "two sizes"),
    "8 GB in forty chunks": lambda: Bomb(recording(*[chunk(zeros(1600 * _BLOCK), 1600 * _BLOCK)] * 40), "would unpack"),
    "schemas of 1 GiB": lambda: Bomb(
        recording(*(block(packed(Schema(n, bytes(GIB // 8), "x", "y"))) for n in range(1, 9))),
        "all schemas and channels",
    ),
    "an unknown compression": lambda: Bomb(recording(chunk(b"x", 1, "xz")), "'xz' is unknown"),
    "a note named 10 000 times": lambda: Bomb(
        recording(_NOTE, index=_indexed(*[MetadataIndex(_NOTE_AT, len(packed(_NOTE)), "n")] * 10_000))
    ),
    "a note beyond the end": lambda: Bomb(recording(index=_indexed(MetadataIndex(1 << 62, 9, "n")))),
    "a note that is none": lambda: Bomb(recording(index=_indexed(MetadataIndex(8, 10, "n")))),
    "an index at the beginning": lambda: Bomb(recording(channel(), start=8)),
    "an index beyond the end": lambda: Bomb(recording(channel(), start=1 << 63)),
    "a short message": lambda: Bomb(recording(channel(), _SHORT), "damaged"),
    "an overlong channel": lambda: Bomb(recording(_OVERLONG, bytes(1000)), "damaged"),
    "a message of no channel": lambda: Bomb(recording(message(_TABLE)), "damaged"),
    "deep JSON": lambda: Bomb(recording(channel(), message(_DEEP)), "nested deeper"),
    "torn JSON": lambda: Bomb(recording(channel(), message(b"{")), "truncated"),
    "a text as a number": lambda: Bomb(recording(_pose_of(boot="b", seq="z")), "Expected `int`"),
    "keys that are paths": lambda: Bomb(recording(channel(key="/../../x"), message(_TABLE))),
    "a key with a NUL": lambda: Bomb(recording(channel(key="uav/\0pose"), message(_TABLE))),
    "a key that is an expression": lambda: Bomb(recording(channel(key="a/**"), message(_TABLE))),
    "a call to nowhere": lambda: Bomb(recording(channel(key="uav/@call/goto"), message(msgspec.json.encode(_CALL)))),
    "a field for each message": lambda: Bomb(
        recording(channel(), *(message(b'{"%d":1}' % n) for n in range(3000)))
    ),
}  # fmt: skip
"""Recordings of less than 1 MB each that would fill the memory, never end or mislead."""
