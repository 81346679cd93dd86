"""Writer of MCAP files in whole chunks, safe on a full disk."""

import contextlib
import os
from pathlib import Path
from typing import Any

import msgspec
from mcap.writer import Writer
from msgspec import Struct

from quadctl.schemas.typeinfo import json_schema
from quadctl.services.runtime.bus.raw import RawMessage
from quadctl.services.runtime.recording.mcap_format import JSON, Form, Stored


class Outfile:
    """Collects what is written until `flush`, which puts all of it into the file, or nothing."""

    def __init__(self, descriptor: int) -> None:
        """Write to an open file, from its beginning on."""
        self.size = 0
        self._descriptor = descriptor
        self._pending = bytearray()

    @classmethod
    def create(cls, path: Path) -> "Outfile":
        """Make the file; raises OSError, FileExistsError where it is there already."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        return cls(os.open(path, flags, 0o666))

    def write(self, data: bytes) -> int:
        """Put something at the end, at the next `flush`."""
        self._pending += data
        return len(data)

    def tell(self) -> int:
        """Where the next byte goes."""
        return self.size + len(self._pending)

    def flush(self) -> None:
        """Hand it to the system, after which only that can lose it.

        Raises OSError, and leaves the file as it was, where the disk has no room.
        """
        rest = memoryview(bytes(self._pending))
        try:
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
        except OSError:
            # What is not a file on a disk cannot be cut, and has nothing that could be read again.
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, self.size)
            raise
        self.size += len(self._pending)
        self._pending.clear()

    def close(self) -> None:
        """Let go of the file."""
        os.close(self._descriptor)


SAID, PACKED, DERIVED = "zenoh_encoding", "packed", "derived"
"""What a channel's metadata says: the encoding on the bus, whether the message was MessagePack
there, and whether it was never there, but made of others for viewers."""
_CHUNK = 4 << 20
"""Bytes after which a chunk ends although nobody has flushed it."""


class BagWriter:
    """One recording. `messages` counts those of the bus, `keys` the keys they came on."""

    def __init__(self, out: Outfile) -> None:
        self.messages = 0
        self.keys: set[str] = set()
        self._out = out
        self._mcap = Writer(out, chunk_size=_CHUNK)  # type: ignore[arg-type] # all it calls is there
        self._mcap.start(library="quadctl")
        self._forms: dict[tuple[str, str], Form] = {}
        self._channels: dict[tuple[Any, ...], int] = {}
        self._schemas: dict[str, int] = {}
        out.flush()

    @property
    def size(self) -> int:
        """Bytes in the file by now."""
        return self._out.size

    def note(self, name: str, values: dict[str, str]) -> None:
        """Keep facts about the recording as a whole."""
        self._mcap.add_metadata(name, values)

    def add(self, taken: RawMessage) -> Stored:
        """Keep a message of the bus; returns how it stands there."""
        key, said = taken.key, taken.encoding
        form = self._forms.get((key, said))
        if form is None:
            form = self._forms[key, said] = Form(key, said)
        stored = form.stored(taken.payload)
        kind = (key, said, stored.encoding, stored.type, stored.packed)
        channel = self._channels.get(kind)
        if channel is None:
            channel = self._channels[kind] = self._bus_channel(key, said, stored)
        self._mcap.add_message(channel, taken.at, stored.data, taken.published)
        self.messages += 1
        return stored

    def derive(self, key: str, name: str, message: Struct, at: int) -> None:
        """Keep a message for viewers, of a type that they know by `name`, at a Unix time, ns."""
        channel = self._channels.get((key, name))
        if channel is None:
            schema = self._schema(name, type(message))
            channel = self._mcap.register_channel(key, JSON, schema, {DERIVED: "yes"})
            self._channels[key, name] = channel
        self._mcap.add_message(channel, at, msgspec.json.encode(message), at)

    def flush(self) -> None:
        """End the chunk and hand it to the system; raises OSError, and then nothing may follow."""
        self._mcap.flush()

    def finish(self) -> None:
        """Write the index that makes it whole; raises OSError."""
        self._mcap.finish()
        self._out.flush()

    def close(self) -> None:
        """Let go of the file, finished or not."""
        self._out.close()

    def _bus_channel(self, key: str, said: str, stored: Stored) -> int:
        schema = 0
        if stored.type is not None:
            schema = self._schema(f"quadctl.{stored.type.__name__}", stored.type)
        facts = {SAID: said, PACKED: "yes" if stored.packed else "no"}
        self.keys.add(key)
        return self._mcap.register_channel(key, stored.encoding, schema, facts)

    def _schema(self, name: str, type_: type[Struct]) -> int:
        if name not in self._schemas:
            text = msgspec.json.encode(json_schema(type_))
            self._schemas[name] = self._mcap.register_schema(name, "jsonschema", text)
        return self._schemas[name]
