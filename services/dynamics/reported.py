"""The pose as it is told: with what is wrong with it. Pure."""

from collections import deque

from msgspec import structs

from schemas.messages import Pose
from schemas.params import FlightFaultParams

_LONGEST = 10.0
"""Seconds of poses that are kept; `dynamics.fault.delay` asks for no more."""

_SLACK = 1e-6
"""What times that are multiples of a period may be off by rounding, s."""


class Reported:
    """Hands poses on as the fault in force leaves them; a changed one counts at once."""

    def __init__(self, params: FlightFaultParams) -> None:
        self._params = params
        self._past: deque[Pose] = deque()
        self._told: Pose | None = None

    def through(self, pose: Pose) -> Pose:
        """What is told in place of the true pose."""
        if self._params.pose == "none":
            self._past.clear()
        else:
            self._keep(pose)
            pose = self._faulty(pose)
        self._told = pose
        return pose

    def _faulty(self, pose: Pose) -> Pose:
        match self._params.pose:
            case "frozen":
                return self._told or pose
            case "delayed":
                then = pose.stamp - self._params.delay + _SLACK
                return next(
                    (old for old in reversed(self._past) if old.stamp <= then), self._past[0]
                )
        place = structs.replace(pose.position, x=pose.position.x + self._params.jump)
        return structs.replace(pose, position=place)

    def _keep(self, pose: Pose) -> None:
        if self._past and self._past[-1].boot != pose.boot:
            self._past.clear()
        self._past.append(pose)
        while self._past[0].stamp < pose.stamp - _LONGEST:
            self._past.popleft()
