"""Data of the automaton: its states, events, world and situation."""

from collections.abc import Sequence
from enum import Enum
from math import inf

from msgspec import Struct
from msgspec.structs import astuple

from quadctl.schemas.messages import Pose
from quadctl.schemas.params import CageParams, SafetyParams
from quadctl.services.airspace import stopping
from quadctl.services.airspace.geometry import Box, Point, place_of
from quadctl.services.airspace.routes import FlightPath
from quadctl.services.airspace.separation import NOBODY, Neighbour, Others
from quadctl.services.airspace.stopping import StoppingLaw
from quadctl.services.airspace.zones import Region

_NO_ZONES = Region()


class State(Enum):
    """The lab's three states, with its numbers."""

    HOVERING = 1
    VERIFYING = 2
    MOVING = 3


class FlightPhase(Enum):
    """FlightPhase of the vehicle's motion; while it is none of a flight, it is published as HOVERING."""

    HOLDING = "holds its goal"
    STOPPED = "holds the place where its stop has ended"
    STOPPING = "brakes to its stopping point"
    PAUSED = "brakes, and flies on when poses come again"
    TAKING_OFF = "takes off; any goal may replace it"
    FLYING = "flies to its goal"


class Goto(Struct, frozen=True):
    """Request for a goal (m, ENU), or for the take-off, which is treated alike."""

    goal: Point
    replace: bool = False
    takeoff: bool = False


class GoalVerdict(Struct, frozen=True):
    """GoalVerdict on the candidate: the route to it, and why it is not flown, empty if it is.

    If that is for other vehicles alone, they are `near`.
    """

    route: FlightPath
    why: str = ""
    near: Sequence[Neighbour] = ()


class Check(Struct, frozen=True):
    """End of the verification of the candidate."""

    verdict: GoalVerdict


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


class World(Struct, frozen=True):
    """Input of the automaton. `fresh` means that the pose may be relied on, else `unready` tells why.

    `last` is the previous pose of the same boot, or for the first one of a boot the same pose. `params`
    are those of `[safety]`; `stop` is the law of the vehicle's stop, `margin` (m) its tolerance in the wind.
    `others` are the vehicles to keep apart from; they count where a goal is verified. `rested` is the
    time (s) for which the vehicle has been at rest, infinite for all its boot.
    """

    pose: Pose
    last: Pose
    fresh: bool
    params: SafetyParams
    stop: StoppingLaw
    margin: float
    unready: str = "no pose: dynamics is silent"
    region: Region = _NO_ZONES
    others: Others = NOBODY
    rested: float = 0.0

    @property
    def place(self) -> Point:
        """Return where the vehicle is, m."""
        return place_of(self.pose)

    @property
    def cage(self) -> CageParams:
        """Return the bounds of the cage."""
        return self.params.virtual_cage

    def stopping_excess(self) -> float:
        """Return how far outside the cage or inside a zone (m) the vehicle soonest comes to rest.

        Each axis may stop as soon as it can, or all together on the line that the vehicle flies: beside
        a zone, only one of the two may be clear.
        """
        pose, limits = self.pose, (self.params.max_deceleration, self.params.reaction)
        here, place = self.place, stopping.soonest_stop(pose, *limits)
        inside = self.region.excess(here, place) if self.region else 0.0
        if inside > 0:
            inside = min(inside, self.region.excess(here, stopping.straight_stop(pose, *limits)))
        return max(stopping.outside(*place, *astuple(self.cage)), inside)

    def leeway(self, law: StoppingLaw) -> float:
        """Return how far out (m) a vehicle that stops by this law may come."""
        return stopping.leeway(self.pose, self.cage, self.region, law)


class Situation(Struct, frozen=True):
    """Memory of the automaton.

    The vehicle flies to `goal` or holds it; one that brakes holds its own stopping point.
    `candidate` is being verified, whatever the phase; a refusal ends that. `beyond` is how far (m)
    outside the cage the vehicle may come to a stop: 0, except for a vehicle that was put outside; then
    it falls as the vehicle comes nearer. It is infinite once a guard has stopped the vehicle. `paused`
    is the flight to resume when poses come again. `corners` are the points (m) to fly to, one by one and each from rest, after `goal`, in a
    flight of so many `legs`; one without corners has 0. The present motion is straight from `origin` (m),
    or a curve somewhere in the box `reach`; it was commanded at the time `commanded` (s).
    """

    goal: Point
    cage_on: bool
    phase: FlightPhase = FlightPhase.STOPPED
    candidate: Goto | None = None
    boot: str = ""
    request: int = 0
    beyond: float = 0.0
    paused: Goto | None = None
    reason: str = ""
    origin: Point = (0.0, 0.0, 0.0)
    reach: Box | None = None
    corners: tuple[Point, ...] = ()
    legs: int = 0
    commanded: float = -inf

    @property
    def state(self) -> State:
        """Return the lab's state."""
        if self.candidate is not None:
            return State.VERIFYING
        return State.MOVING if self.flies else State.HOVERING

    @property
    def flies(self) -> bool:
        """Return whether it is on its way to a goal."""
        return self.phase is FlightPhase.FLYING or self.phase is FlightPhase.TAKING_OFF

    @property
    def stops(self) -> bool:
        """Return whether it brakes, and has not come to rest."""
        return self.phase is FlightPhase.STOPPING or self.phase is FlightPhase.PAUSED

    @property
    def brake(self) -> bool:
        """Return whether it holds its own stopping point."""
        return self.stops or self.phase is FlightPhase.STOPPED

    @property
    def leg(self) -> int:
        """Return the number of the present leg, 0 in a flight without corners."""
        return self.legs - len(self.corners) if self.legs else 0

    @property
    def end(self) -> Point:
        """Return the end of the whole way, m."""
        return self.corners[-1] if self.corners else self.goal
