"""Writes a recording: MCAP in small chunks, each of them whole on the disk once it is flushed."""

from typing import Any

import msgspec
from mcap.writer import Writer
from msgspec import Struct

from schemas.jsonschema import json_schema
from services.runtime.bag.form import JSON, Form, Stored
from services.runtime.bag.outfile import Outfile
from services.runtime.bus.tap import Taken

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

    def add(self, taken: Taken) -> Stored:
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
