"""Data of the automaton: its states, events, world and situation."""

from enum import Enum

from msgspec import Struct

from quadctl.schemas.messages import CageSize, Pose, Position


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
    """Order to verify the candidate now."""


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
    """Limits of the vehicle's motion, m/s and m/s^2, with a margin, m; beyond, it is unreliable."""

    speed: float
    deceleration: float
    margin: float


class World(Struct, frozen=True):
    """Input of the automaton. `fresh` means that the pose may be relied on, else `unready` tells why.

    `last` is the previous pose of the same boot, or for the first one of a boot the same pose.
    """

    pose: Pose
    last: Pose
    fresh: bool
    cage: CageSize
    acceptance_range: float
    envelope: Envelope
    unready: str = "no pose: dynamics is silent"


class Situation(Struct, frozen=True):
    """Memory of the automaton.

    The vehicle flies to `goal` or holds it; with `brake` it holds its own stopping point.
    `candidate` is being verified, and a refusal leads back to `back`. `settling` is true during a
    stop. `beyond` is how far (m) outside the cage the vehicle may come to a stop: 0, except for a
    vehicle that was put outside; then it falls as the vehicle comes nearer. It is infinite once a
    guard has stopped the vehicle. `paused` is the flight to resume when poses come again. `since`
    (s) is the time of the last change of the cage.
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
