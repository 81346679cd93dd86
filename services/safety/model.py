"""Data of the automaton: its states, events, world and situation."""

from enum import Enum
from math import inf

from msgspec import Struct

from quadctl.schemas.messages import CageSize, Pose, Position
from quadctl.services.safety.separation import Neighbour
from quadctl.services.safety.zones import Box, Region

_NO_ZONES = Region()


class State(Enum):
    """The lab's three states, with its numbers."""

    HOVERING = 1
    VERIFYING = 2
    MOVING = 3


class Goto(Struct, frozen=True):
    """Request for a goal (m, ENU), or for the take-off, which is treated alike."""

    goal: Position
    replace: bool = False
    takeoff: bool = False


class Check(Struct, frozen=True):
    """Order to verify the candidate now, by the corners (m) of a way, if any; it may be searched for.

    A `direct` way has none. With `waits`, a goal too near another vehicle is to wait for it.
    """

    corners: tuple[Position, ...] = ()
    searched: bool = False
    direct: bool = False
    waits: bool = False


class Seen(Struct, frozen=True):
    """Arrival of a pose."""


class Lost(Struct, frozen=True):
    """Silence of poses for so long (s) that the vehicle has to brake."""

    limit: float


class Gone(Struct, frozen=True):
    """Silence of poses beyond the grace: the flight is over, even if a pose comes now."""

    reason: str


class Lagged(Struct, frozen=True):
    """End of a short silence of setpoints, in which the vehicle braked by itself."""

    reason: str


class Halted(Struct, frozen=True):
    """Stop of the vehicle by itself: it lacked setpoints for too long, or follows none."""

    reason: str


class Booted(Struct, frozen=True):
    """Pose of another boot: requests to the old one are void."""

    reason: str


class Hold(Struct, frozen=True):
    """Request to stop."""

    reason: str = "hold: stopped on request"


class Toggle(Struct, frozen=True):
    """Request to turn the cage on or off."""

    cage_on: bool


class Resized(Struct, frozen=True):
    """Change of the cage's bounds."""


Event = Goto | Check | Seen | Lost | Gone | Lagged | Halted | Booted | Hold | Toggle | Resized


class Envelope(Struct, frozen=True):
    """Limits of the vehicle's motion, m/s and m/s^2, with a margin, m; beyond, it is unreliable.

    It flies on for the time `reaction` (s) before it brakes. It speeds up with `acceleration` (m/s^2)
    at most; infinite if that is unknown.
    """

    speed: float
    deceleration: float
    margin: float
    reaction: float = 0.0
    acceleration: float = inf


class World(Struct, frozen=True):
    """Input of the automaton. `fresh` means that the pose may be relied on, else `unready` tells why.

    `last` is the previous pose of the same boot, or for the first one of a boot the same pose.
    `others` are the vehicles to keep apart from; they count where a goal is verified. `rested` is the
    time (s) for which the vehicle has been at rest, infinite for all its boot.
    """

    pose: Pose
    last: Pose
    fresh: bool
    cage: CageSize
    acceptance_range: float
    envelope: Envelope
    unready: str = "no pose: dynamics is silent"
    region: Region = _NO_ZONES
    others: tuple[Neighbour, ...] = ()
    rested: float = inf


class Situation(Struct, frozen=True):
    """Memory of the automaton.

    The vehicle flies to `goal` or holds it; with `brake` it holds its own stopping point.
    `candidate` is being verified, and a refusal leads back to `back`. `settling` is true during a
    stop. `beyond` is how far (m) outside the cage the vehicle may come to a stop: 0, except for a
    vehicle that was put outside; then it falls as the vehicle comes nearer. It is infinite once a
    guard has stopped the vehicle. `paused` is the flight to resume when poses come again. `since`
    (s) is the time of the last change of the cage. `corners` are the points (m) to fly to, one by
    one and each from rest, after `goal`, which is the end of `leg` of `legs`; without corners all
    are 0. The present motion is straight from `origin` (m), or a curve somewhere in the box `reach`;
    it was commanded at the time `commanded` (s).
    """

    state: State
    goal: Position
    cage_on: bool
    candidate: Goto
    back: State = State.HOVERING
    boot: str = ""
    request: int = 0
    brake: bool = True
    settling: bool = False
    takeoff: bool = False
    beyond: float = 0.0
    since: float = 0.0
    paused: Goto | None = None
    reason: str = ""
    origin: Position = Position(0.0, 0.0, 0.0)
    reach: Box | None = None
    corners: tuple[Position, ...] = ()
    leg: int = 0
    legs: int = 0
    commanded: float = -inf

    @property
    def end(self) -> Position:
        """Return the end of the whole way, m."""
        return self.corners[-1] if self.corners else self.goal
