"""Looks through a recording for what is wrong with it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from schemas.topics import TOPICS
from services.runtime.bag import form
from services.runtime.bag.reader import Bag, Recorded

_TYPES = {f"quadctl.{topic.type.__name__}": topic.type for topic in TOPICS}
_MOST = 20
"""Faults that are told; who has that many needs no more."""


class Checked(NamedTuple):
    """How many messages were looked at, and what is wrong, a line each; empty where nothing is."""

    messages: int
    faults: list[str]


def check(path: Path) -> Checked:
    """Read every message against its schema; raises Invalid where it is no recording."""
    bag, count, last = Bag(path), 0, 0
    faults: list[str] = []
    gaps = _Gaps()
    for message in bag.messages():
        count += 1
        faults += _faults(message, last)
        gaps.see(message)
        last = max(last, message.at)
    faults += gaps.faults()
    if bag.cut:
        faults.insert(0, f"it is cut: {bag.cut}")
    more = [f"and {len(faults) - _MOST} faults more"] if len(faults) > _MOST else []
    return Checked(count, faults[:_MOST] + more)


def _faults(message: Recorded, last: int) -> Iterator[str]:
    if message.at < last:
        yield f"{message.key}: a message came {(last - message.at) / 1e9:g} s before the one before it"
    if message.channel.message_encoding != form.JSON:
        return
    if message.schema is None and message.channel.schema_id:
        yield f"{message.key}: its schema is missing"
    name = message.schema.name if message.schema else ""
    try:
        msgspec.json.decode(message.data, type=_TYPES.get(name, dict))
    except msgspec.MsgspecError as error:
        yield f"{message.key}: a message is no {name or 'table'}: {error}"


class _Gaps:
    """Poses are counted by their publisher: what is missing in between was lost on its way."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[str, int]] = {}
        self._lost: dict[str, int] = {}

    def see(self, message: Recorded) -> None:
        if message.schema is None or message.schema.name != "quadctl.Pose":
            return
        pose: Any = message.value
        if not isinstance(pose, dict) or "seq" not in pose:
            return
        boot, seq = self._last.get(message.key, ("", -1))
        if pose.get("boot") == boot and pose["seq"] > seq + 1:
            lost = pose["seq"] - seq - 1
            self._lost[message.key] = self._lost.get(message.key, 0) + lost
        self._last[message.key] = (pose.get("boot", ""), pose["seq"])

    def faults(self) -> Iterator[str]:
        for key, lost in self._lost.items():
            yield f"{key}: {lost} messages are missing in between"
