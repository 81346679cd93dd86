"""Expected effect of every rule of the automaton, independent of the rule table.

A case has a situation, an event, a world, and the expected next situation. `given` has the
differences from PLAIN, `then` those from the situation. In PLAIN only the condition `always`
is true, so that a rule with a wrong condition fails.
"""

from math import inf
from typing import Any, NamedTuple

from msgspec.structs import replace

from quadctl.schemas.messages import Position
from quadctl.services.safety.cage import SLACK, leeway
from quadctl.services.safety.model import (
    Booted,
    Check,
    Event,
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
    BELOW,
    BESIDE_CORNER,
    BLIND,
    BY,
    FASTER,
    GOAL,
    HERE,
    HOVERING,
    INSIDE,
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
        return replace(PLAIN, state=self.at, **self.given)

    @property
    def expected(self) -> Situation:
        """Return the expected situation after the event."""
        return replace(self.situation, **self.then)


def stopped(reason: str, goal: Position = HERE) -> dict[str, Any]:
    return {
        "state": HOVERING, "goal": goal, "brake": True, "settling": True, "takeoff": False,
        "reason": reason,
    }  # fmt: skip


def guarded(reason: str, goal: Position = HERE) -> dict[str, Any]:
    """Return the changes of a stop by a guard that reports it once."""
    return stopped(reason, goal) | {"beyond": inf}


def caged(world: World) -> dict[str, Any]:
    """Return the changes of a new cage while the vehicle leaves it."""
    return {"beyond": leeway(world) + SLACK, "since": 4.0}


def waiting(reason: str, takeoff: bool = False) -> dict[str, Any]:
    return stopped(reason) | {"paused": Goto(GOAL, takeoff=takeoff)}


def considered(goal: Goto, back: State) -> dict[str, Any]:
    return {"state": VERIFYING, "request": 8, "candidate": goal, "back": back, "reason": ""}


def refused(state: State, reason: str) -> dict[str, Any]:
    return {"state": state, "request": 8, "reason": reason}


BOOT = {
    "state": HOVERING, "boot": "b2", "goal": HERE, "brake": True, "settling": False,
    "takeoff": False, "beyond": SLACK, "since": 4.0, "reason": "anew",
}  # fmt: skip
TAKEN = {
    "state": MOVING, "brake": False, "settling": False, "takeoff": False, "reason": "",
}  # fmt: skip
INSIDE_AGAIN, TOLD, STRICT = {"beyond": 0.0}, {"beyond": inf}, {"beyond": 0.0}
CAGED, FAR_OUT = {"beyond": SLACK, "since": 4.0}, caged(FASTER)
BESIDE = "stopped, the path led out of the cage by 0.05 m"
NOTHING: dict[str, Any] = {}
STOPPING = {"brake": True, "settling": True}
TAKING_OFF = {"takeoff": True}
OFF, FAR = {"cage_on": False}, {"goal": OUTSIDE}
FROM_FLIGHT = {"back": MOVING}
FOR_INSIDE, FOR_BELOW = {"candidate": Goto(INSIDE)}, {"candidate": Goto(BELOW)}
SILENT, LAGGED = Gone("no pose for 1 s"), Lagged("the vehicle received no setpoint for 0.3 s")
PAUSE = "paused: no pose for 0.2 s"
PAUSED = {"paused": Goto(GOAL), "brake": True, "settling": True, "reason": PAUSE}
WENT_ON = "went on after a pause: "
RESUMED = {
    "state": MOVING, "goal": GOAL, "brake": False, "settling": False, "takeoff": False,
    "paused": None, "reason": f"{WENT_ON}no pose for 0.2 s",
}  # fmt: skip
OVER = {"paused": None}
CHANGED = {"paused": None, "reason": "stopped, the cage was changed during a pause"}
GIVEN_UP = "no pose for 1 s: stopped"
GOTO, REPLACE, BOOTED = Goto(INSIDE), Goto(INSIDE, replace=True), Booted("anew")
HALTED = Halted("by itself")

ON_LEG = {"corners": (INSIDE,), "leg": 1, "legs": 2}
NO_LEG: dict[str, Any] = {"corners": (), "leg": 0, "legs": 0}
SETTLED = {"brake": True, "goal": HERE, "candidate": Goto(GOAL)}
CROSSES = "the way crosses the zone tower"

# fmt: off
CASES = (
    Case(HOVERING, "blind", GOTO, refused(HOVERING, NO_POSE), BLIND),
    Case(HOVERING, "blind", REPLACE, refused(HOVERING, NO_POSE), BLIND),
    Case(HOVERING, "blind", GOTO, refused(HOVERING, f"paused: {NO_POSE}; no goal is taken during a pause"),
         BLIND, PAUSED),
    Case(HOVERING, "always", GOTO, considered(GOTO, HOVERING)),
    Case(HOVERING, "always", Goto(OUTSIDE), considered(Goto(OUTSIDE), HOVERING)),
    Case(HOVERING, "always", GOTO, considered(GOTO, HOVERING), given=FROM_FLIGHT),
    Case(HOVERING, "always", Check(), NOTHING),
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
    Case(HOVERING, "settled", Seen(), {"goal": HERE, "settling": False}, AT_REST, STOPPING),
    Case(HOVERING, "settled", Seen(), {"goal": OUT, "settling": False}, RESTS_OUT, STOPPING | TOLD),
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
    Case(HOVERING, "always", BOOTED, BOOT | OVER, REBOOTED, PAUSED),
    Case(HOVERING, "always", Hold(), stopped(HELD)),
    Case(HOVERING, "always", Hold(), stopped(HELD) | OVER, given=PAUSED),
    Case(HOVERING, "always", Toggle(cage_on=False), OFF | CAGED | CHANGED, given=PAUSED),
    Case(HOVERING, "always", Toggle(cage_on=False), OFF | CAGED | CHANGED | NO_LEG, given=PAUSED | ON_LEG),
    Case(HOVERING, "always", GOTO, considered(GOTO, HOVERING) | OVER | NO_LEG, given=PAUSED | ON_LEG),
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
    Case(VERIFYING, "permitted", Check(), {**TAKEN, "goal": INSIDE}, given=FOR_INSIDE),
    Case(VERIFYING, "permitted", Check(), {**TAKEN, "goal": INSIDE}, given=FOR_INSIDE | STOPPING),
    Case(VERIFYING, "permitted", Check(), {**TAKEN, "goal": INSIDE}, given=FOR_INSIDE | FROM_FLIGHT),
    Case(VERIFYING, "permitted", Check(), {**TAKEN, "goal": INSIDE}, given=FOR_INSIDE | TAKING_OFF),
    Case(VERIFYING, "permitted", Check(), {**TAKEN, "goal": OUTSIDE}, given=OFF),
    Case(VERIFYING, "permitted", Check(), {**TAKEN, "goal": INSIDE, "takeoff": True},
         given={"candidate": Goto(INSIDE, takeoff=True)}),
    Case(VERIFYING, "permitted", Check(), {**TAKEN, "goal": INSIDE},
         given=FROM_FLIGHT | FAR | FOR_INSIDE),
    Case(VERIFYING, "permitted", Check(), {**TAKEN, "goal": INSIDE, **FAR_OUT},
         FASTER, FOR_INSIDE | TOLD),
    Case(VERIFYING, "permitted", Check((BY, BEHIND)),
         {**TAKEN, "goal": BY, "corners": (BEHIND, GOAL), "leg": 1, "legs": 3}, AMONG, SETTLED),
    Case(VERIFYING, "permitted", Check((BY, BEHIND)), {**TAKEN, "goal": GOAL}, AMONG, SETTLED | OFF),
    Case(VERIFYING, "always", Check(), {"state": HOVERING, "reason": CROSSES}, AMONG, SETTLED),
    Case(VERIFYING, "always", Check((BY,)), {"state": HOVERING, "reason": CROSSES}, AMONG, SETTLED),
    Case(VERIFYING, "always", Check((OUTSIDE,)), {"state": HOVERING, "reason": BEYOND}, AMONG, SETTLED),
    Case(VERIFYING, "always", Check((), searched=True),
         {"state": HOVERING, "reason": f"{CROSSES}; no way around it was found"}, AMONG, SETTLED),
    Case(VERIFYING, "always", Check(), {"state": HOVERING, "reason": "inside the zone tower"}, AMONG,
         SETTLED | FOR_INSIDE),
    Case(VERIFYING, "barred", Check(), stopped(BARRED), given=FROM_FLIGHT | FAR),
    Case(VERIFYING, "barred", Check(), stopped(BARRED), given=FROM_FLIGHT | FAR | TAKING_OFF),
    Case(VERIFYING, "from_flight", Check(), {"state": MOVING, "reason": BEYOND}, given=FROM_FLIGHT),
    Case(VERIFYING, "from_flight", Check(), {"state": MOVING, "reason": BEYOND},
         given=FROM_FLIGHT | TAKING_OFF),
    Case(VERIFYING, "always", Check(), {"state": HOVERING, "reason": BEYOND}),
    Case(VERIFYING, "always", Check(), {"state": HOVERING, "reason": BEYOND}, given=STOPPING),
    Case(VERIFYING, "barred", Check(), stopped(BARRED), given=FAR),
    Case(VERIFYING, "always", Check(), {"state": HOVERING, "reason": BEYOND}, given=FOR_BELOW),
    Case(VERIFYING, "always", Check(), {"state": HOVERING, "reason": UNDER}, given=OFF | FOR_BELOW),
    Case(VERIFYING, "from_flight", Check(), {"state": MOVING, "reason": UNDER},
         given=OFF | FOR_BELOW | FROM_FLIGHT),
    Case(VERIFYING, "always", GOTO, refused(VERIFYING, BUSY)),
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
    Case(MOVING, "blind", GOTO, refused(MOVING, NO_POSE), BLIND),
    Case(MOVING, "blind", REPLACE, refused(MOVING, NO_POSE), BLIND),
    Case(MOVING, "blind", GOTO, refused(MOVING, NO_POSE), BLIND, TAKING_OFF),
    Case(MOVING, "may_replace", REPLACE, considered(REPLACE, MOVING)),
    Case(MOVING, "may_replace", GOTO, considered(GOTO, MOVING), given=TAKING_OFF),
    Case(MOVING, "always", GOTO, refused(MOVING, BUSY)),
    Case(MOVING, "always", Check(), NOTHING),
    Case(MOVING, "arrived", Seen(), {"state": HOVERING, "reason": ""}, NEAR),
    Case(MOVING, "arrived", Seen(), {"state": HOVERING, "reason": "", **NO_LEG}, NEAR, {"leg": 2, "legs": 2}),
    Case(MOVING, "cornering", Seen(), {"goal": INSIDE, "corners": (), "leg": 2}, AT_CORNER, ON_LEG),
    Case(MOVING, "cornering", Seen(), INSIDE_AGAIN, NEAR, ON_LEG),
    Case(MOVING, "cornering", Seen(), INSIDE_AGAIN, AT_REST, ON_LEG),
    Case(MOVING, "cornering", Seen(), INSIDE_AGAIN, PASSING_CORNER, ON_LEG),
    Case(MOVING, "cornering", Seen(), INSIDE_AGAIN, BESIDE_CORNER, ON_LEG),
    Case(MOVING, "straying", Seen(), guarded(BESIDE, OUT) | NO_LEG, RESTS_OUT,
         ON_LEG | STRICT | {"goal": OUT}),
    Case(MOVING, "arrived", Seen(), {"state": HOVERING, "reason": ""}, AT_CORNER),
    Case(MOVING, "arrived", Seen(), {"state": HOVERING, "reason": "", "takeoff": False}, NEAR,
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
    Case(MOVING, "always", Seen(), {"beyond": leeway(AS_FAST)}, AS_FAST, {"beyond": 9.0}),
    Case(MOVING, "straying", Seen(), guarded(ASTRAY, OUT), SLOWER),
    Case(MOVING, "always", Seen(), NOTHING, AS_FAST, {"beyond": 9.0, "since": 3.6}),
    Case(MOVING, "always", Seen(), NOTHING, FASTER, OFF),
    Case(MOVING, "always", Seen(), INSIDE_AGAIN),
    Case(MOVING, "always", Seen(), INSIDE_AGAIN, RUSHED),
    Case(MOVING, "always", Seen(), INSIDE_AGAIN, AT_RANGE),
    Case(MOVING, "always", Seen(), INSIDE_AGAIN, AT_REST, STOPPING),
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
