"""Contents of a recording: received messages, calls, and published messages of each node."""

from pathlib import Path
from typing import Any

import msgspec

from quadctl.schemas.messages import Called, NearestWall, Pose, Pressure, SafetyState, Setpoint
from quadctl.schemas.params import Params
from quadctl.schemas.topics import POSE, POSE_SLOW, PRESSURE, REQUEST, topic_of
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.recording.reader import Bag
from quadctl.services.runtime.testing import Published

_INPUTS = {topic.name: topic for topic in (POSE, POSE_SLOW, REQUEST)}


class Recorded:
    """Recording of one vehicle's flight at a speed other than 1; `boot` is the flight's.

    At such a speed the output of a node depends only on its input.
    """

    def __init__(self, path: Path) -> None:
        bag = Bag(path)
        self.received: list[tuple[Any, Any]] = []
        self.calls: list[Called] = []
        self.published: list[Published] = []
        for message in bag.messages():
            topic: Any = topic_of(message.key)
            if topic is None or message.derived:
                continue
            value = codec.decode(topic.type, message.payload, message.encoding)
            if isinstance(value, Called):
                self.calls.append(value)
            elif topic.name in _INPUTS:
                self.received.append((_INPUTS[topic.name], value))
            else:
                self.published.append(Published(topic.name, value))
        assert not bag.cut
        self.params = msgspec.json.decode(bag.notes["quadctl"]["params"], type=Params)
        self.boot = [value.boot for _, value in self.received if isinstance(value, Pose)][-1]

    def transitions(self, published: list[Published]) -> list[SafetyState]:
        """Return safety's states in this flight, without repetitions.

        Requests are counted from the flight's first. Of a reason it counts that there is one. The
        nearest wall is another one at each pose.
        """
        found: list[SafetyState] = []
        replace = msgspec.structs.replace
        for _, message in published:
            if isinstance(message, SafetyState) and message.boot == self.boot:
                state = replace(message, nearest=NearestWall())
                last = found[-1] if found else None
                if last is None or replace(last, stamp=state.stamp) != state:
                    found.append(state)
        return [
            replace(s, request=s.request - found[0].request, reason="a reason" if s.reason else "")
            for s in found
        ]

    def setpoints(self, published: list[Published]) -> list[Setpoint]:
        """Return the setpoints of this flight, without repetitions."""
        of_boot = [s for _, s in published if isinstance(s, Setpoint) and s.boot == self.boot]
        # A setpoint may be sent again in case it was lost.
        return [s for before, s in zip([None, *of_boot], of_boot, strict=False) if s != before]

    def readings(self, published: list[Published]) -> list[Pressure]:
        """Return the barometer's readings in this flight, which start at 0 s."""
        found: list[Pressure] = []
        for name, reading in published:
            if name != PRESSURE.name or not isinstance(reading, Pressure):
                continue
            if reading.stamp == 0:
                found.clear()
            if reading.stamp == 0 or (found and reading.stamp > found[-1].stamp):
                found.append(reading)
        return found
