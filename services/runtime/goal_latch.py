"""Goals that a vehicle follows, and those that are void because it has braked by itself. Pure."""

from quadctl.schemas.messages import Position


class GoalLatch:
    """Memory of a goal that is void because the vehicle has braked by itself.

    After a silence within the grace, the vehicle resumes its goal. After a longer one it must not:
    a person who saw it stop may be standing there. Then it follows only a new request to safety:
    another goal, or any goal after a setpoint to brake, which shows that safety knows of the stop.
    """

    def __init__(self) -> None:
        self._goal: Position | None = None
        self._void: Position | None = None

    def stopped(self) -> None:
        """Void the goal: the vehicle brakes because no setpoint comes."""
        self._void = self._goal

    def resumed(self) -> None:
        """Restore the goal: setpoints were missing for no longer than the grace."""
        self._void = None

    def accepts(self, goal: Position, *, brake: bool) -> bool:
        """Return whether the vehicle follows a setpoint."""
        if not brake and goal == self._void:
            return False
        self._goal, self._void = None if brake else goal, None
        return True
