"""Data of the automaton: its states, events, world and situation."""

from enum import Enum

from msgspec import Struct

from quadctl.schemas.messages import CageSize, Pose, Position


class State(Enum):
    """The lab's three states, and its numbers for them."""

    HOVERING = 1
    VERIFYING = 2
    MOVING = 3


class Ask(Struct, frozen=True):
    """Someone asks for a goal (m, ENU); the take-off is asked for like any other."""

    goal: Position
    replace: bool = False
    takeoff: bool = False


class Check(Struct, frozen=True):
    """Verify the candidate now."""


class Seen(Struct, frozen=True):
    """A pose came."""


class Lost(Struct, frozen=True):
    """No pose came for so long (s) that the vehicle is to brake."""

    limit: float


class Gone(Struct, frozen=True):
    """No pose came for longer than the grace: the flight is over, also where one comes now."""

    reason: str


class Lagged(Struct, frozen=True):
    """The vehicle heard no setpoint for a while, braked by itself, and hears again."""

    reason: str


class Halted(Struct, frozen=True):
    """The vehicle heard no setpoint for too long, or follows none: it has stopped by itself."""

    reason: str


class Booted(Struct, frozen=True):
    """A pose of another boot came: what was asked of the old one is void."""

    reason: str


class Hold(Struct, frozen=True):
    """Someone asks to stop."""


class Toggle(Struct, frozen=True):
    """Someone turns the cage on or off."""

    cage_on: bool


class Resized(Struct, frozen=True):
    """The cage has other bounds now."""


Event = Ask | Check | Seen | Lost | Gone | Lagged | Halted | Booted | Hold | Toggle | Resized


class Envelope(Struct, frozen=True):
    """What the vehicle can do at the most; what is seen to do more is not to be relied on.

    `speed` in m/s, `deceleration` in m/s^2; `margin` is how far (m) it may be off.
    """

    speed: float
    deceleration: float
    margin: float


class World(Struct, frozen=True):
    """What the automaton looks at. `fresh` says that the pose may be relied on.

    `last` is the pose before this one, of the same boot; the first one of a boot is its own.
    """

    pose: Pose
    last: Pose
    fresh: bool
    cage: CageSize
    acceptance_range: float
    envelope: Envelope


class Situation(Struct, frozen=True):
    """What the automaton remembers.

    `goal` is flown to or held, with `brake` the vehicle's own stopping point is; `candidate`
    is being verified, and a refusal leads back to `back`. `settling` while a stop goes on.
    `beyond` is how far (m) out of the cage the vehicle may come to a stop: 0 but for one that was
    put outside, of which it falls as the vehicle comes nearer; infinite once a guard has stopped it.
    `paused` is the flight that goes on when poses come again.
    `since` (s) is when the cage became what it is.
    """

    state: State
    goal: Position
    cage_on: bool
    candidate: Ask
    back: State = State.HOVERING
    boot: str = ""
    request: int = 0
    brake: bool = True
    settling: bool = False
    takeoff: bool = False
    beyond: float = 0.0
    since: float = 0.0
    paused: Ask | None = None
    reason: str = ""
