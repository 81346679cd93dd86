"""Which setpoints move the vehicle. Pure."""

from schemas.messages import Position


class Heed:
    """After a brake of its own the vehicle goes on to the goal that it had within a grace alone.

    After a longer silence somebody may have come near. Then it goes on for what was asked of safety
    since: for another goal, or after a setpoint to brake, which says that safety knows of the stop.
    """

    def __init__(self) -> None:
        self._goal: Position | None = None
        self._void: Position | None = None

    def stopped(self) -> None:
        """The vehicle brakes because it hears nothing."""
        self._void = self._goal

    def resumed(self) -> None:
        """Go on with the goal: setpoints were missing for no longer than the grace."""
        self._void = None

    def heeds(self, goal: Position, *, brake: bool) -> bool:
        """Whether a setpoint is followed."""
        if not brake and goal == self._void:
            return False
        self._goal, self._void = None if brake else goal, None
        return True
