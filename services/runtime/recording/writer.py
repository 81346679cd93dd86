"""Writer of MCAP files in whole chunks, safe on a full disk."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any

import msgspec
from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import Writer
from msgspec import Struct

from quadctl.schemas.typeinfo import json_schema
from quadctl.services.runtime.bus.streams import RawMessage
from quadctl.services.runtime.filelock import lock_open
from quadctl.services.runtime.recording.mcap_format import JSON, Form, Stored


class Outfile:
    """Output file that buffers until `flush`, which writes all of the buffer or nothing."""

    def __init__(self, descriptor: int) -> None:
        """Write to an open file from its start, locked as long as it is open."""
        self.size = 0
        self._descriptor = descriptor
        lock_open(descriptor)
        self._pending = bytearray()

    @classmethod
    def create(cls, path: Path) -> "Outfile":
        """Create the file; raises OSError, FileExistsError if it exists."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        return cls(os.open(path, flags, 0o666))

    def write(self, data: bytes) -> int:
        """Append to the buffer."""
        self._pending += data
        return len(data)

    def tell(self) -> int:
        """Return the position of the next byte."""
        return self.size + len(self._pending)

    def flush(self) -> None:
        """Write the buffer to the file; if that raises OSError, the file is unchanged."""
        rest = memoryview(bytes(self._pending))
        try:
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
        except OSError:
            # A pipe cannot be truncated, and needs no repair.
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, self.size)
            raise
        self.size += len(self._pending)
        self._pending.clear()

    def is_at(self, path: Path) -> bool:
        """Return whether the file still has this name; it may have been removed or moved."""
        try:
            return os.path.samestat(os.fstat(self._descriptor), path.stat())
        except OSError:
            return False

    def is_removed(self) -> bool:
        """Return whether the file has no name any more: nobody could read what is written."""
        return os.fstat(self._descriptor).st_nlink == 0

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)


ENCODING, PACKED, DERIVED = "zenoh_encoding", "packed", "derived"
"""Keys of a channel's metadata: encoding on the bus, MessagePack there, made only for viewers."""
_CHUNK = 4 << 20
"""Bytes after which a chunk ends without a flush."""
MOST_CHANNELS = 65_000
"""Channels of messages of the bus, with numbers of 16 bits; those for viewers come on top."""


class _ChunkIndices:
    """Index of the chunks so far, in a nameless file: an hour has 14 400 entries of some 500 bytes.

    It takes the place of a list in mcap's writer, which would keep them in memory.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._records = folder, RecordBuilder()
        self._file: IO[bytes] | None = None

    def append(self, index: ChunkIndex) -> None:
        """Buffer an entry until the next `flush`."""
        index.write(self._records)

    def flush(self) -> None:
        """Write the buffer to the file; raises OSError."""
        if self._records.count:
            self._file = self._file or TemporaryFile(dir=self._folder)  # noqa: SIM115 - close() closes it
            self._file.write(self._records.end())
            self._file.flush()

    def __iter__(self) -> Iterator["_ChunkIndices"]:
        yield self

    def write(self, summary: RecordBuilder) -> None:
        """Write all entries to the recording's summary."""
        self.flush()
        if self._file is not None:
            self._file.seek(0)
            summary.write(self._file.read())

    def close(self) -> None:
        """Remove the file."""
        if self._file is not None:
            self._file.close()


class BagWriter:
    """Writer of one recording; counts the `messages` of the bus and collects their `keys`.

    `left_out` counts the messages of keys for which the file has no channel left.
    """

    def __init__(self, out: Outfile, folder: Path) -> None:
        """Write to a file in `folder`, where its index waits for the end; raises OSError."""
        self.messages = self.left_out = 0
        self.keys: set[str] = set()
        self._out = out
        self._mcap = Writer(out, chunk_size=_CHUNK)  # type: ignore[arg-type] # all it calls is there
        self._indices = _ChunkIndices(folder)
        self._mcap._Writer__chunk_indices = self._indices  # type: ignore[attr-defined] # noqa: SLF001 - see there
        self._mcap.start(library="quadctl")
        self._forms: dict[tuple[str, str], Form] = {}
        self._channels: dict[tuple[Any, ...], int] = {}
        self._schemas: dict[str, int] = {}
        out.flush()

    @property
    def size(self) -> int:
        """Return the size of the file, bytes."""
        return self._out.size

    def note(self, name: str, values: dict[str, str]) -> None:
        """Write notes about the whole recording."""
        self._mcap.add_metadata(name, values)

    def add(self, raw: RawMessage) -> Stored:
        """Write a message of the bus, if there is a channel for it; returns its stored form."""
        key, encoding = raw.key, raw.encoding
        form = self._forms.get((key, encoding)) or Form(key, encoding)
        stored = form.stored(raw.payload)
        kind = (key, encoding, stored.encoding, stored.type, stored.packed)
        channel = self._channels.get(kind)
        if channel is None:
            if len(self._channels) >= MOST_CHANNELS:
                self.left_out += 1
                return stored
            self._forms[key, encoding] = form
            channel = self._channels[kind] = self._bus_channel(key, encoding, stored)
        self._mcap.add_message(channel, raw.at, stored.data, raw.published or raw.at)
        self.messages += 1
        return stored

    def derive(self, key: str, name: str, message: Struct, at: int) -> None:
        """Write a message for viewers, with their `name` of its type, at a Unix time, ns."""
        channel = self._channels.get((key, name))
        if channel is None:
            schema = self._schema(name, type(message))
            channel = self._mcap.register_channel(key, JSON, schema, {DERIVED: "yes"})
            self._channels[key, name] = channel
        self._mcap.add_message(channel, at, msgspec.json.encode(message), at)

    def flush(self) -> None:
        """End the chunk and write it; after an OSError the writer must not be used again."""
        self._mcap.flush()
        self._indices.flush()

    def finish(self) -> None:
        """Write the index that completes the recording; raises OSError."""
        self._mcap.finish()
        self._out.flush()

    def close(self) -> None:
        """Close the file, finished or not."""
        self._indices.close()
        self._out.close()

    def _bus_channel(self, key: str, encoding: str, stored: Stored) -> int:
        type_ = stored.type
        schema = 0 if type_ is None else self._schema(f"quadctl.{type_.__name__}", type_)
        facts = {ENCODING: encoding, PACKED: "yes" if stored.packed else "no"}
        self.keys.add(key)
        return self._mcap.register_channel(key, stored.encoding, schema, facts)

    def _schema(self, name: str, type_: type[Struct]) -> int:
        if name not in self._schemas:
            text = msgspec.json.encode(json_schema(type_))
            self._schemas[name] = self._mcap.register_schema(name, "jsonschema", text)
        return self._schemas[name]
