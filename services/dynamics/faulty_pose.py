"""Poses as an injected fault changes them. Pure."""

from collections import deque

from msgspec import structs

from quadctl.schemas.messages import Pose
from quadctl.schemas.params import FlightFaultParams

_LONGEST = 10.0
"""Seconds of poses that are kept: the most that `dynamics.fault.delay` can need."""
_SLACK = 1e-6
"""Rounding error (s) of times that are multiples of a period."""


class FaultyPose:
    """Poses as the fault in force changes them; a new fault counts at once."""

    def __init__(self, params: FlightFaultParams) -> None:
        self._params = params
        self._past: deque[Pose] = deque()
        self._given: Pose | None = None

    def through(self, pose: Pose) -> Pose:
        """Return the pose to publish for a true pose."""
        if self._params.pose == "none":
            self._past.clear()
        else:
            if self._past and self._past[-1].boot != pose.boot:
                self._past.clear()
            self._past.append(pose)
            while self._past[0].stamp < pose.stamp - _LONGEST:
                self._past.popleft()
            pose = self._faulty(pose)
        self._given = pose
        return pose

    def _faulty(self, pose: Pose) -> Pose:
        match self._params.pose:
            case "frozen":
                return self._given or pose
            case "delayed":
                then = pose.stamp - self._params.delay + _SLACK
                return next(
                    (old for old in reversed(self._past) if old.stamp <= then), self._past[0]
                )
        place = structs.replace(pose.position, x=pose.position.x + self._params.jump)
        return structs.replace(pose, position=place)
