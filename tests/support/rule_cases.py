"""Expected effect of every rule of the automaton, independent of the rule table.

A case has a situation, an event, a world, and the expected next situation. `given` has the
differences from PLAIN, `then` those from the situation. In PLAIN only the condition `always`
is true, so that a rule with a wrong condition fails.
"""

from math import inf
from typing import Any, NamedTuple

from msgspec.structs import replace

from quadctl.services.airspace.geometry import Point
from quadctl.services.airspace.routes import FlightPath
from quadctl.services.safety.model import (
    Booted,
    Check,
    Event,
    FlightPhase,
    GoalVerdict,
    Gone,
    Goto,
    Halted,
    Hold,
    Lagged,
    Lost,
    Resized,
    Seen,
    Situation,
    State,
    Toggle,
    World,
)
from tests.support.worlds import (
    AMONG,
    AS_FAST,
    AT_CORNER,
    AT_RANGE,
    AT_REST,
    BEHIND,
    BESIDE_CORNER,
    BLIND,
    BY,
    FASTER,
    GOAL,
    HERE,
    HOVERING,
    INSIDE,
    LAW,
    LEAPT,
    LEAPT_OUT,
    LEAPT_TO_REST,
    MOVING,
    NEAR,
    OUT,
    OUTSIDE,
    PASSING_CORNER,
    PLAIN,
    REBOOTED,
    RESTS_OUT,
    RUSHED,
    SEEING,
    SLOWER,
    VERIFYING,
)

NO_POSE = "no pose: dynamics is silent"
BUSY = "busy: flying to (3, 0, 1); ask with replace to change course"
BEYOND = "outside the cage: x = 9 is beyond [-5, 5]"
UNDER = "below the floor: z = -0.25 is less than 0"
LOST = "no pose for 0.2 s: stopped"
HELD = "hold: stopped on request"
ALONE = "stopped, by itself"
BARRED = "stopped, the goal is now outside the cage: x = 9 is beyond [-5, 5]"
IN_PLACE = "hovering in place, the goal is now outside the cage: x = 9 is beyond [-5, 5]"
ASTRAY = "stopped, the path led out of the cage by 0.25 m"
JUMPED = "stopped, the pose jumped by 0.511 m in 0.05 s"


class Case(NamedTuple):
    """Case for the rule of a state and an event, selected by its condition's name."""

    at: State
    when: str
    event: Event
    then: dict[str, Any]
    world: World = SEEING
    given: dict[str, Any] = {}  # noqa: RUF012 - never changed

    @property
    def rule(self) -> tuple[State, type[Event], str]:
        """Return the key of the rule."""
        return self.at, type(self.event), self.when

    @property
    def situation(self) -> Situation:
        """Return the situation before the event."""
        return replace(PLAIN, **AT[self.at] | self.given)

    @property
    def expected(self) -> Situation:
        """Return the expected situation after the event."""
        return replace(self.situation, **self.then)


AT: dict[State, dict[str, Any]] = {
    HOVERING: {},
    VERIFYING: {"candidate": Goto(OUTSIDE)},
    MOVING: {"phase": FlightPhase.FLYING},
}
"""Differences of a situation in each state from PLAIN."""


def stopped(reason: str, goal: Point = HERE) -> dict[str, Any]:
    return {"candidate": None, "goal": goal, "phase": FlightPhase.STOPPING, "reason": reason}


def guarded(reason: str, goal: Point = HERE) -> dict[str, Any]:
    """Return the changes of a stop by a guard that reports it once."""
    return stopped(reason, goal) | {"beyond": inf}


def caged(world: World) -> dict[str, Any]:
    """Return the changes of a new cage while the vehicle leaves it."""
    return {"beyond": world.leeway(LAW)}


def waiting(reason: str, takeoff: bool = False) -> dict[str, Any]:
    return stopped(reason) | {"phase": FlightPhase.PAUSED, "paused": Goto(GOAL, takeoff=takeoff)}


def considered(goal: Goto) -> dict[str, Any]:
    return {"request": 8, "candidate": goal, "reason": ""}


def refused(reason: str) -> dict[str, Any]:
    return {"request": 8, "reason": reason}


def flown(*points: Point) -> Check:
    """Return the verdict that a route by these points is flown."""
    return Check(GoalVerdict(FlightPath(HERE, None, points)))


BOOT = {
    "candidate": None, "boot": "b2", "goal": HERE, "phase": FlightPhase.STOPPED, "beyond": 0.0,
    "reason": "anew",
}  # fmt: skip
TAKEN = {"candidate": None, "goal": INSIDE, "phase": FlightPhase.FLYING, "reason": ""}
INSIDE_AGAIN, TOLD, STRICT = {"beyond": 0.0}, {"beyond": inf}, {"beyond": 0.0}
CAGED, FAR_OUT = {"beyond": 0.0}, caged(FASTER)
BESIDE = "stopped, the path led out of the cage by 0.05 m"
NOTHING: dict[str, Any] = {}
STOPPING = {"phase": FlightPhase.STOPPING}
TAKING_OFF = {"phase": FlightPhase.TAKING_OFF}
OFF, FAR = {"cage_on": False}, {"goal": OUTSIDE}
FROM_FLIGHT = {"phase": FlightPhase.FLYING}
YES, NO = flown(INSIDE), Check(GoalVerdict(FlightPath(HERE, None, (OUTSIDE,)), BEYOND))
NOT_TAKEN = {"candidate": None, "reason": BEYOND}
SILENT, LAGGED = Gone("no pose for 1 s"), Lagged("the vehicle received no setpoint for 0.3 s")
PAUSE = "paused: no pose for 0.2 s"
PAUSED = {"paused": Goto(GOAL), "phase": FlightPhase.PAUSED, "reason": PAUSE}
WENT_ON = "went on after a pause: "
RESUMED = {
    "phase": FlightPhase.FLYING, "goal": GOAL, "paused": None, "reason": f"{WENT_ON}no pose for 0.2 s",
}  # fmt: skip
OVER = {"paused": None, "phase": FlightPhase.STOPPING}
CHANGED = OVER | {"reason": "stopped, the cage was changed during a pause"}
GIVEN_UP = "no pose for 1 s: stopped"
GOTO, REPLACE, BOOTED = Goto(INSIDE), Goto(INSIDE, replace=True), Booted("anew")
HALTED = Halted("by itself")

ON_LEG = {"corners": (INSIDE,), "legs": 2}
NO_LEG: dict[str, Any] = {"corners": (), "legs": 0}
CROSSES = "the way crosses the zone tower"
ARRIVED = {"phase": FlightPhase.HOLDING, "reason": ""}

# fmt: off
CASES = (
    Case(HOVERING, "blind", GOTO, refused(NO_POSE), BLIND),
    Case(HOVERING, "blind", REPLACE, refused(NO_POSE), BLIND),
    Case(HOVERING, "blind", GOTO, refused(f"paused: {NO_POSE}; no goal is taken during a pause"),
         BLIND, PAUSED),
    Case(HOVERING, "always", GOTO, considered(GOTO)),
    Case(HOVERING, "always", Goto(OUTSIDE), considered(Goto(OUTSIDE))),
    Case(HOVERING, "always", YES, NOTHING),
    Case(HOVERING, "always", NO, NOTHING),
    Case(HOVERING, "jumped", Seen(), guarded(JUMPED), LEAPT),
    Case(HOVERING, "jumped", Seen(), guarded(JUMPED), LEAPT_TO_REST, STOPPING),
    Case(HOVERING, "jumped", Seen(), guarded("stopped, the pose jumped by 5.05 m in 0.05 s", OUT),
         LEAPT_OUT),
    Case(HOVERING, "jumped", Seen(), guarded(JUMPED) | OVER, LEAPT, PAUSED),
    Case(HOVERING, "paused", Seen(), RESUMED, given=PAUSED),
    Case(HOVERING, "paused", Seen(), RESUMED | TAKING_OFF,
         given=PAUSED | {"paused": Goto(GOAL, takeoff=True)}),
    Case(HOVERING, "straying", Seen(), guarded(ASTRAY, OUT) | OVER, FASTER, PAUSED),
    Case(HOVERING, "paused", Seen(), RESUMED, AT_REST, PAUSED),
    Case(HOVERING, "straying", Seen(), guarded(ASTRAY, OUT), FASTER),
    Case(HOVERING, "straying", Seen(), guarded(ASTRAY, OUT), SLOWER, STOPPING),
    Case(HOVERING, "straying", Seen(), guarded(BESIDE, OUT), RESTS_OUT, STOPPING | STRICT),
    Case(HOVERING, "settled", Seen(), {"goal": HERE, "phase": FlightPhase.STOPPED}, AT_REST, STOPPING),
    Case(HOVERING, "settled", Seen(), {"goal": OUT, "phase": FlightPhase.STOPPED}, RESTS_OUT, STOPPING | TOLD),
    Case(HOVERING, "always", Seen(), INSIDE_AGAIN, RUSHED),
    Case(HOVERING, "always", Seen(), INSIDE_AGAIN),
    Case(HOVERING, "always", Seen(), INSIDE_AGAIN, given=STOPPING),
    Case(HOVERING, "always", Seen(), INSIDE_AGAIN, AT_REST),
    Case(HOVERING, "always", Seen(), INSIDE_AGAIN, NEAR),
    Case(HOVERING, "always", Seen(), NOTHING, FASTER, TOLD),
    Case(HOVERING, "always", Seen(), NOTHING, FASTER, OFF),
    Case(HOVERING, "always", Lost(0.2), NOTHING),
    Case(HOVERING, "always", Lost(0.2), NOTHING, given=STOPPING),
    Case(HOVERING, "always", Lost(0.2), NOTHING, given=PAUSED),
    Case(HOVERING, "paused", SILENT, stopped(GIVEN_UP) | OVER, given=PAUSED),
    Case(HOVERING, "always", SILENT, NOTHING),
    Case(HOVERING, "always", LAGGED, NOTHING),
    Case(HOVERING, "always", LAGGED, NOTHING, given=PAUSED),
    Case(HOVERING, "always", HALTED, NOTHING),
    Case(HOVERING, "always", HALTED, NOTHING, given=STOPPING),
    Case(HOVERING, "always", BOOTED, BOOT, REBOOTED),
    Case(HOVERING, "always", BOOTED, BOOT, REBOOTED, STOPPING),
    Case(HOVERING, "always", BOOTED, BOOT | {"paused": None}, REBOOTED, PAUSED),
    Case(HOVERING, "always", Hold(), stopped(HELD)),
    Case(HOVERING, "always", Hold(), stopped(HELD) | OVER, given=PAUSED),
    Case(HOVERING, "always", Toggle(cage_on=False), OFF | CAGED | CHANGED, given=PAUSED),
    Case(HOVERING, "always", Toggle(cage_on=False), OFF | CAGED | CHANGED | NO_LEG, given=PAUSED | ON_LEG),
    Case(HOVERING, "always", GOTO, considered(GOTO) | OVER | NO_LEG, given=PAUSED | ON_LEG),
    Case(HOVERING, "paused", Seen(), RESUMED, given=PAUSED | ON_LEG),
    Case(HOVERING, "always", Resized(), CAGED | CHANGED, given=PAUSED),
    Case(HOVERING, "barred", Toggle(cage_on=True), stopped(IN_PLACE) | {"cage_on": True} | CAGED,
         given=OFF | FAR),
    Case(HOVERING, "always", Toggle(cage_on=False), OFF | CAGED),
    Case(HOVERING, "always", Toggle(cage_on=False), OFF | CAGED, given=FAR),
    Case(HOVERING, "always", Toggle(cage_on=True), {"cage_on": True} | CAGED, given=OFF),
    Case(HOVERING, "always", Toggle(cage_on=True), {"cage_on": True} | CAGED,
         given=OFF | FAR | STOPPING),
    Case(HOVERING, "barred", Resized(), stopped(IN_PLACE) | CAGED, given=FAR),
    Case(HOVERING, "always", Resized(), CAGED),
    Case(HOVERING, "always", Resized(), FAR_OUT, FASTER),
    Case(HOVERING, "always", Resized(), CAGED, given=OFF | FAR),
    Case(HOVERING, "always", Resized(), CAGED, given=FAR | STOPPING),
    Case(VERIFYING, "permitted", YES, TAKEN),
    Case(VERIFYING, "permitted", YES, TAKEN, given=STOPPING),
    Case(VERIFYING, "permitted", YES, TAKEN, given=FROM_FLIGHT),
    Case(VERIFYING, "permitted", YES, TAKEN, given=TAKING_OFF),
    Case(VERIFYING, "permitted", YES, TAKEN, given=OFF),
    Case(VERIFYING, "permitted", YES, TAKEN | TAKING_OFF, given={"candidate": Goto(INSIDE, takeoff=True)}),
    Case(VERIFYING, "permitted", YES, TAKEN, given=FROM_FLIGHT | FAR),
    Case(VERIFYING, "permitted", YES, TAKEN | FAR_OUT, FASTER, TOLD),
    Case(VERIFYING, "permitted", flown(BY, BEHIND, GOAL),
         TAKEN | {"goal": BY, "corners": (BEHIND, GOAL), "legs": 3}),
    Case(VERIFYING, "barred", NO, stopped(BARRED), given=FAR),
    Case(VERIFYING, "barred", NO, stopped(BARRED), given=FROM_FLIGHT | FAR),
    Case(VERIFYING, "barred", NO, stopped(BARRED), given=TAKING_OFF | FAR),
    Case(VERIFYING, "from_flight", NO, NOT_TAKEN, given=FROM_FLIGHT),
    Case(VERIFYING, "from_flight", NO, NOT_TAKEN, given=TAKING_OFF),
    Case(VERIFYING, "always", NO, NOT_TAKEN),
    Case(VERIFYING, "always", NO, NOT_TAKEN, given=STOPPING),
    Case(VERIFYING, "always", NO, NOT_TAKEN, given=OFF),
    Case(VERIFYING, "always", GOTO, refused(BUSY)),
    Case(VERIFYING, "always", Seen(), NOTHING),
    Case(VERIFYING, "always", Seen(), NOTHING, NEAR),
    Case(VERIFYING, "always", Lost(0.2), stopped(LOST)),
    Case(VERIFYING, "always", SILENT, stopped(GIVEN_UP)),
    Case(VERIFYING, "always", LAGGED, NOTHING),
    Case(VERIFYING, "always", HALTED, stopped(ALONE)),
    Case(VERIFYING, "always", HALTED, stopped(ALONE), AT_REST),
    Case(VERIFYING, "always", BOOTED, BOOT, REBOOTED),
    Case(VERIFYING, "always", Hold(), stopped(HELD)),
    Case(VERIFYING, "always", Toggle(cage_on=False), OFF | CAGED),
    Case(VERIFYING, "always", Resized(), CAGED),
    Case(VERIFYING, "always", Resized(), caged(SLOWER), SLOWER),
    Case(MOVING, "blind", GOTO, refused(NO_POSE), BLIND),
    Case(MOVING, "blind", REPLACE, refused(NO_POSE), BLIND),
    Case(MOVING, "blind", GOTO, refused(NO_POSE), BLIND, TAKING_OFF),
    Case(MOVING, "may_replace", REPLACE, considered(REPLACE)),
    Case(MOVING, "may_replace", GOTO, considered(GOTO), given=TAKING_OFF),
    Case(MOVING, "always", GOTO, refused(BUSY)),
    Case(MOVING, "always", YES, NOTHING),
    Case(MOVING, "always", NO, NOTHING),
    Case(MOVING, "arrived", Seen(), ARRIVED, NEAR),
    Case(MOVING, "arrived", Seen(), ARRIVED | NO_LEG, NEAR, {"legs": 2}),
    Case(MOVING, "cornering", Seen(), {"goal": INSIDE, "corners": ()}, AT_CORNER, ON_LEG),
    Case(MOVING, "cornering", Seen(), INSIDE_AGAIN, NEAR, ON_LEG),
    Case(MOVING, "cornering", Seen(), INSIDE_AGAIN, AT_REST, ON_LEG),
    Case(MOVING, "cornering", Seen(), INSIDE_AGAIN, PASSING_CORNER, ON_LEG),
    Case(MOVING, "cornering", Seen(), INSIDE_AGAIN, BESIDE_CORNER, ON_LEG),
    Case(MOVING, "straying", Seen(), guarded(BESIDE, OUT) | NO_LEG, RESTS_OUT,
         ON_LEG | STRICT | {"goal": OUT}),
    Case(MOVING, "arrived", Seen(), ARRIVED, AT_CORNER),
    Case(MOVING, "arrived", Seen(), ARRIVED, NEAR,
         TAKING_OFF),
    Case(MOVING, "jumped", Seen(), guarded(JUMPED), LEAPT),
    Case(MOVING, "jumped", Seen(), guarded(JUMPED), LEAPT, TAKING_OFF),
    Case(MOVING, "jumped", Seen(), guarded("stopped, the pose jumped by 5.05 m in 0.05 s", OUT),
         LEAPT_OUT),
    Case(MOVING, "straying", Seen(), guarded(ASTRAY, OUT), FASTER),
    Case(MOVING, "straying", Seen(), guarded(ASTRAY, OUT), AS_FAST),
    Case(MOVING, "straying", Seen(), guarded(ASTRAY, OUT), FASTER, {"goal": OUT}),
    Case(MOVING, "straying", Seen(), guarded(ASTRAY, OUT), FASTER, {"beyond": 0.2375}),
    Case(MOVING, "always", Seen(), NOTHING, FASTER, {"beyond": 0.2425}),
    Case(MOVING, "always", Seen(), {"beyond": AS_FAST.leeway(LAW.steady)}, AS_FAST,
         {"beyond": 9.0}),
    Case(MOVING, "always", Seen(), {"beyond": AS_FAST.leeway(LAW), "commanded": -inf}, AS_FAST,
         {"beyond": 9.0, "commanded": 3.8}),
    Case(MOVING, "straying", Seen(), guarded(ASTRAY, OUT), SLOWER),
    Case(MOVING, "always", Seen(), NOTHING, FASTER, OFF),
    Case(MOVING, "always", Seen(), INSIDE_AGAIN),
    Case(MOVING, "always", Seen(), INSIDE_AGAIN, RUSHED),
    Case(MOVING, "always", Seen(), INSIDE_AGAIN, AT_RANGE),
    Case(MOVING, "always", Seen(), INSIDE_AGAIN, AT_REST),
    Case(MOVING, "always", Lost(0.2), waiting(PAUSE)),
    Case(MOVING, "always", Lost(0.2), waiting(PAUSE) | ON_LEG, given=ON_LEG),
    Case(MOVING, "always", Lost(0.2), waiting(PAUSE, takeoff=True), given=TAKING_OFF),
    Case(MOVING, "always", SILENT, stopped(GIVEN_UP)),
    Case(MOVING, "always", SILENT, stopped(GIVEN_UP), given=TAKING_OFF),
    Case(MOVING, "always", LAGGED, {"reason": WENT_ON + LAGGED.reason}),
    Case(MOVING, "always", HALTED, stopped(ALONE)),
    Case(MOVING, "always", HALTED, stopped(ALONE), AT_REST, TAKING_OFF),
    Case(MOVING, "always", BOOTED, BOOT, REBOOTED),
    Case(MOVING, "always", BOOTED, BOOT, REBOOTED, TAKING_OFF),
    Case(MOVING, "always", Hold(), stopped(HELD)),
    Case(MOVING, "always", Hold(), stopped(HELD) | NO_LEG, given=ON_LEG),
    Case(MOVING, "barred", Resized(), stopped(f"stopped, {CROSSES}") | CAGED, AMONG),
    Case(MOVING, "barred", Resized(), stopped("stopped, the goal is now inside the zone tower") | CAGED | NO_LEG,
         AMONG, ON_LEG),
    Case(MOVING, "barred", Resized(), stopped(BARRED) | CAGED | NO_LEG, given={"corners": (OUTSIDE,)}),
    Case(MOVING, "always", Hold(), stopped(HELD), given=TAKING_OFF),
    Case(MOVING, "barred", Toggle(cage_on=True), stopped(BARRED) | {"cage_on": True} | CAGED,
         given=OFF | FAR),
    Case(MOVING, "barred", Toggle(cage_on=True), stopped(BARRED) | CAGED, given=FAR),
    Case(MOVING, "always", Toggle(cage_on=True), {"cage_on": True} | CAGED, given=OFF),
    Case(MOVING, "always", Toggle(cage_on=True), {"cage_on": True} | FAR_OUT,
         FASTER, OFF),
    Case(MOVING, "always", Toggle(cage_on=False), OFF | CAGED),
    Case(MOVING, "always", Toggle(cage_on=False), OFF | CAGED, given=FAR),
    Case(MOVING, "barred", Resized(), stopped(BARRED) | CAGED, given=FAR),
    Case(MOVING, "always", Resized(), CAGED),
    Case(MOVING, "always", Resized(), FAR_OUT, FASTER),
    Case(MOVING, "always", Resized(), CAGED, given=OFF | FAR),
)
# fmt: on
