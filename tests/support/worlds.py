"""Situations and worlds for the tests of the automaton."""

from msgspec.structs import replace

from quadctl.schemas.messages import BodyRates, Pose, Position, Quaternion, Velocity
from quadctl.schemas.params import CageParams, SafetyParams
from quadctl.schemas.zones import ZoneParams
from quadctl.services.airspace.stopping import StoppingLaw
from quadctl.services.airspace.zones import Region
from quadctl.services.safety.model import FlightPhase, Situation, State, World

HOVERING, VERIFYING, MOVING = State

HERE = (0.0, 0.0, 1.0)
GOAL = (3.0, 0.0, 1.0)
INSIDE = (1.0, 2.0, 1.5)
OUTSIDE = (9.0, 0.0, 1.0)
BELOW = (9.0, 0.0, -0.25)
PARAMS = SafetyParams(virtual_cage=CageParams(5.0, 5.0, 2.0))

FLYING, RESTING = Velocity(1.0, 0.0, 0.0), Velocity(0.0, 0.0, 0.049)
POSE = Pose(
    "b1", 0, 4.0, Position(*HERE), FLYING, Quaternion(1.0, 0.0, 0.0, 0.0), BodyRates(0.0, 0.0, 0.0)
)
LAST = replace(POSE, position=Position(-0.05, 0.0, 1.0), stamp=3.95)
LAW = StoppingLaw(response=0.25, acceleration=4.0, deceleration=2.0)
SEEING = World(POSE, LAST, fresh=True, params=PARAMS, stop=LAW, margin=0.01)
BLIND = replace(SEEING, fresh=False)
AT_REST = replace(
    SEEING, pose=replace(POSE, velocity=RESTING), last=replace(LAST, velocity=RESTING), rested=9.0
)
REBOOTED = replace(SEEING, pose=replace(POSE, boot="b2"))
AT_GOAL = replace(SEEING, last=replace(LAST, position=Position(2.45, 0.0, 1.0)))
NEAR = replace(AT_GOAL, pose=replace(POSE, position=Position(2.501, 0.0, 1.0)))
LEAPT = replace(SEEING, last=replace(LAST, position=Position(0.511, 0.0, 1.0)))
RUSHED = replace(SEEING, last=replace(LAST, position=Position(0.509, 0.0, 1.0)))
LEAPT_TO_REST = replace(LEAPT, pose=AT_REST.pose)


def leaving(before: float, x: float = 5.05) -> World:
    """Return a world leaving the cage at 2 m/s (0.2 m to stop soonest), after another speed (m/s)."""
    pose = replace(POSE, position=Position(x, 0.0, 1.0), velocity=Velocity(2.0, 0.0, 0.0))
    past = Position(x - 0.1, 0.0, 1.0)
    last = replace(LAST, position=past, velocity=Velocity(before, 0.0, 0.0))
    return replace(SEEING, pose=pose, last=last)


FASTER, AS_FAST, SLOWER = leaving(1.0), leaving(2.0), leaving(3.0)
OUT = FASTER.place
RESTS_OUT = replace(FASTER, pose=replace(FASTER.pose, velocity=RESTING))
LEAPT_OUT = replace(FASTER, last=replace(FASTER.last, position=Position(*HERE)))
AT_RANGE = replace(AT_GOAL, pose=replace(POSE, position=Position(2.5, 0.0, 1.0)))

AT_CORNER = replace(
    AT_REST,
    pose=replace(AT_REST.pose, position=Position(2.99, 0.0, 1.0)),
    last=replace(AT_REST.last, position=Position(*GOAL)),
)
PASSING_CORNER = replace(AT_CORNER, rested=0.2)
BESIDE_CORNER = replace(AT_CORNER, pose=replace(AT_CORNER.pose, position=Position(2.955, 0.0, 1.0)))
TOWER = ZoneParams("tower", "exclusion", polygon=((0.5, -1.0), (2.0, -1.0), (2.0, 2.5), (0.5, 2.5)))
AMONG = replace(AT_REST, region=Region((TOWER,)))
"""A tower is between HERE and GOAL; INSIDE is in it."""
BY = (0.25, 2.75, 1.0)
BEHIND = (2.25, 2.75, 1.0)

PLAIN = Situation(
    GOAL,
    cage_on=True,
    phase=FlightPhase.HOLDING,
    boot="b1",
    request=7,
    beyond=0.125,
    reason="before",
)
