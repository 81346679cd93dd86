"""Test rig of a monitor: feeds poses to it, and records the published states."""

from msgspec.structs import replace

from quadctl.schemas.messages import Pose, Position, SafetyState, Velocity
from quadctl.schemas.params import CageParams, SafetyParams
from quadctl.services.safety.monitor import Monitor
from tests.support.worlds import POSE

GROUND, ONE_UP = Position(0.0, 0.0, 0.0), Position(0.0, 0.0, 1.0)
INSIDE, OTHER, OUTSIDE = Position(3.0, 0.0, 1.0), Position(0.0, 3.0, 1.0), Position(9.0, 0.0, 1.0)
STILL = Velocity(0.0, 0.0, 0.0)
BEYOND = "outside the cage: x = 9 is beyond [-5, 5]"


class Rig:
    """Monitor with a simulated pose source; `published` has the states and log lines."""

    def __init__(self, *, restarted: bool = False, **params: object) -> None:
        cage = CageParams(5.0, 5.0, 2.0)
        self.params = SafetyParams(**({"virtual_cage": cage} | params))  # type: ignore[arg-type]
        self.published: list[tuple[SafetyState, str]] = []
        self.monitor = Monitor(
            self.params,
            lambda state, line: self.published.append((state, line)),
            restarted=restarted,
            grace=1.0,
        )
        self._stamp = 0.0

    def at(self, place: Position, velocity: Velocity = STILL, boot: str = "b1") -> SafetyState:
        """Feed a pose one second newer than the previous one, long enough for a distant place."""
        self._stamp += 1.0
        self.monitor.see(self.pose(self._stamp, place, velocity, boot))
        return self.state

    @staticmethod
    def pose(stamp: float, place: Position, velocity: Velocity = STILL, boot: str = "b1") -> Pose:
        return replace(
            POSE, stamp=stamp, seq=round(stamp), position=place, velocity=velocity, boot=boot
        )

    @property
    def state(self) -> SafetyState:
        return self.monitor.state()

    def hovering(self) -> "Rig":
        """Take off, and hover at rest one metre up."""
        self.at(GROUND)
        assert self.at(ONE_UP).state == "HOVERING"
        # The next pose shows that it can stop inside, so that no slack of the boot is left.
        self.at(ONE_UP)
        return self

    def moving(self) -> "Rig":
        """Take off, and fly towards INSIDE."""
        assert self.hovering().monitor.goto(INSIDE) == ""
        assert self.state.state == "MOVING"
        return self
