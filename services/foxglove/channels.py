"""Channels of the server: each key's messages as JSON, with the schemas of a recording."""

import time
from typing import Any

import msgspec
from foxglove import Channel, Context, Schema
from foxglove.websocket import ChannelView, Client
from msgspec import Struct

from quadctl.schemas.topics import TOPICS
from quadctl.schemas.typeinfo import json_schema
from quadctl.services.runtime.recording.mcap_format import JSON
from quadctl.services.runtime.recording.scene import (
    FRAMES_KEY,
    SCENE,
    SCENE_KEY,
    TRANSFORM,
    Derived,
    Drawing,
    FrameTransform,
    SceneUpdate,
)

_FREE = Schema(name="json", encoding="jsonschema", data=b'{"type": "object", "properties": {}}')
"""Schema of a user's own JSON; viewers need one."""


class Channels:
    """Channels of all vehicles, and what a late subscriber gets of them at once."""

    def __init__(self) -> None:
        self.context = Context()
        self._channels: dict[tuple[str, str], Channel] = {}
        self._latched: dict[int, tuple[bytes, int]] = {}
        self._drawings: list[Drawing] = []
        self._frames = self._channel(FRAMES_KEY, TRANSFORM, FrameTransform)
        self._scene = self._channel(SCENE_KEY, SCENE, SceneUpdate)

    def add(self, vehicle: str, drawing: Drawing) -> None:
        """Declare the topics of a vehicle, before their first messages."""
        self._drawings.append(drawing)
        for topic in TOPICS:
            self.of(topic.key(vehicle), topic.type)

    def of(self, key: str, type_: type[Struct] | None) -> Channel:
        """Return the channel of a key's messages of one type, None for a user's own."""
        name = "" if type_ is None else f"quadctl.{type_.__name__}"
        return self._channel(key, name, type_)

    @property
    def frames_wanted(self) -> bool:
        """Return whether a client has subscribed to the frames of the vehicles."""
        return self._frames.has_sinks()

    def log(self, channel: Channel, data: bytes, at: int, *, latched: bool) -> None:
        """Send a message to a channel's subscribers; keep one that is latched for late ones."""
        if latched:
            self._latched[channel.id()] = data, at
        channel.log(data, log_time=at)

    def draw(self, derived: Derived, at: int) -> None:
        """Send a message that is made for viewers."""
        channel = self._frames if derived.key == FRAMES_KEY else self._scene
        if channel.has_sinks():
            channel.log(msgspec.json.encode(derived.message), log_time=at)

    def welcome(self, client: Client, view: ChannelView) -> None:
        """Send the last state, or the whole scene, to a client that has just subscribed."""
        if view.id == self._scene.id():
            for drawing in tuple(self._drawings):
                if derived := drawing.whole(at := time.time_ns()):
                    data = msgspec.json.encode(derived.message)
                    self._scene.log(data, log_time=at, sink_id=client.id)
        elif kept := self._latched.get(view.id):
            data, at = kept
            for channel in tuple(self._channels.values()):
                if channel.id() == view.id:
                    channel.log(data, log_time=at, sink_id=client.id)

    def _channel(self, key: str, name: str, type_: type[Struct] | None) -> Channel:
        kind = key, name
        if kind not in self._channels:
            schema = _FREE if type_ is None else schema_of(name, type_)
            self._channels[kind] = Channel(
                key, schema=schema, message_encoding=JSON, context=self.context
            )
        return self._channels[kind]


def schema_of(name: str, type_: type[Struct]) -> Schema:
    """Return the JSON schema of a type under this name."""
    data: Any = msgspec.json.encode(json_schema(type_))
    return Schema(name=name, encoding="jsonschema", data=data)
