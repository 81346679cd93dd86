"""Whether the vehicle follows what it is told, as its poses show. Pure."""

from math import inf

from schemas.messages import Pose, Position
from services.safety.reach import at_rest

PATIENCE = 1.0
"""A vehicle that stands still for so long (s) on its way to a goal does not follow."""
STANDS = f"the vehicle stood still for {PATIENCE:g} s on its way"


class Following:
    """Looks at the newest pose at least once in a period of the setpoint.

    A setpoint answers a pose. Poses that come only after a while, because this process or the bus
    was held up, show a vehicle that meanwhile heard nothing; one that was held up itself has not
    flown on either.
    """

    def __init__(self) -> None:
        self._boot, self._stamp = "", 0.0
        self._goal: Position | None = None
        self._still_since: float | None = None

    @property
    def due(self) -> float:
        """The stamp (s) beyond which a vehicle that now stands still on its way is in trouble, else inf."""
        return inf if self._still_since is None else self._still_since + PATIENCE

    def look(self, pose: Pose, goal: Position | None, *, moving: bool) -> tuple[float, bool]:
        """Return for how long (s) the vehicle has heard nothing, and whether it does not follow.

        `goal` is what it is told, None to brake; `moving` says that it is on its way. A goal that is
        new since the last look is heard now.
        """
        same = pose.boot == self._boot and goal is not None and goal == self._goal
        gap = pose.stamp - self._stamp if same else 0.0
        self._boot, self._stamp, self._goal = pose.boot, pose.stamp, goal
        if not (same and moving and at_rest(pose)):
            self._still_since = None
        elif self._still_since is None:
            self._still_since = pose.stamp
        stands = self._still_since is not None and pose.stamp - self._still_since > PATIENCE
        return gap, stands
