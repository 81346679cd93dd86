"""Proof about the safety automaton and its monitor: induction over events and over calls.

Claim: the clauses of `invariant` hold after every sequence of events of any length, and those of
`transition` for every event. Base: the situation that `Monitor` starts with. Step: for every
situation that satisfies the invariant, every event and every world, the situation that `step`
returns satisfies both. A second induction is over the calls of a `Monitor`, one at a time, in any
order, with any arguments; there VERIFYING never outlasts a call.

Why the proof holds for the code:

- It has no model of the code. `unknown` makes the arguments from the types of `model.py`, so a new
  field, state or event is included; tests/support/symbolic.py then runs the real `step` with its
  table, conditions and actions, and the real methods of `Monitor`. Each path is taken that the
  conditions allow, and an exception on any path fails the proof.
- Numbers are IEEE doubles, NaN and infinities included, and `inside` is written here once more, in
  the solver's terms. All that the invariant needs are comparisons, and they are exact.
- Geometry is replaced by more than it can do (`abstracted`): `leeway` and `stopping_excess` return
  any number at each call; functions of `math`, sums and products any, but equal for equal arguments (a
  sum with a known infinity is exact). So it holds wherever the guards trip, and says nothing about where. Zones
  bar any places, boxes (`AnyRegion`) and ways, and a way around them has any corners. Other vehicles
  (`AnyOthers`) may be too near any way, and a vehicle at rest or at its goal at any time.
- Limits on goals are those of `LIMITS` in motion.py, each with a clause. That of the cage is written here
  once more, by `place` and `inside`; what others refuse is left to their tests.
- Boots are compared for equality alone, so the unset boot, the present one, a new one and one that
  is over stand for all. A reason may be any text.

Assumptions:

- `Event`, `Situation` and `World` hold values of their types: decoding checks them at the edge.
- The cage changes with `Resized` alone: `Node.params_changed` calls `Monitor.resize` at once, on
  the one thread on which all calls run. `on_state` and `on_rule` do not call the monitor back.
- For `step` alone: the pose is fresh at `Seen` and `Booted`, is so no more after `Lost`, and changes
  at no other event. The second induction proves this of `Monitor`.
- The geometry raises no error: the deceleration is positive. The bounds of the cage are finite, for
  one clause: otherwise a goal at infinity could be refused without a reason. A boot has a name.
- The tracking monitor may report anything. Python, msgspec and the solver are right.

Over 500 lines: the clauses, the events and the calls are one argument, to be read as a whole.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from copy import copy
from functools import partial
from itertools import chain, islice, product
from math import inf
from typing import Any, NamedTuple

import pytest
import z3
from msgspec import Struct
from msgspec.structs import asdict, astuple, replace

from quadctl.schemas.messages import CageSize, Pose, Position
from quadctl.schemas.params import CageParams, SafetyParams
from quadctl.schemas.zones import ZoneParams
from quadctl.services.airspace import routes, stopping
from quadctl.services.airspace.cage import Cage
from quadctl.services.airspace.geometry import Box, Point
from quadctl.services.airspace.separation import How, Neighbour, Others
from quadctl.services.airspace.stopping import StoppingLaw
from quadctl.services.airspace.zones import Nearest, Region
from quadctl.services.safety import automaton, monitor, motion
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
    Lost,
    Resized,
    Seen,
    Situation,
    State,
    Toggle,
    World,
)
from quadctl.services.safety.monitor import Monitor
from tests.support.symbolic import (
    FLOAT,
    OPAQUE,
    Number,
    Truth,
    known,
    opaque,
    paths,
    term,
    unknown,
    violation,
)

HOVERING, VERIFYING, MOVING = State
Clauses = dict[str, z3.BoolRef]


class Failure(NamedTuple):
    """Counterexample: the clause, and values that violate it: situation, event or call, world."""

    clause: str
    values: tuple[Any, ...]

    def __str__(self) -> str:
        """Return it as a story: the promise that breaks, then each value with its fields."""
        lines = [f"broken: {self.clause}"]
        for value in self.values:
            lines.append(f"  {type(value).__name__}" if isinstance(value, Struct) else f"  {value}")
            if isinstance(value, Struct):
                fields = value.__struct_fields__
                lines += [f"    {name}: {getattr(value, name)!r}" for name in fields]
        return "\n".join(lines)


def story(failures: Iterable[Failure]) -> str:
    """Return the counterexamples one after the other, whole; empty if there is none."""
    return "\n\n".join(map(str, failures))


class Proof:
    """Obligations checked so far; `check` yields the failed ones."""

    def __init__(self) -> None:
        self.obligations = 0

    def check(
        self,
        given: Clauses,
        run: Callable[[], Any],
        clauses: Callable[[Any], Clauses],
        *values: Any,
    ) -> Iterator[Failure]:
        """Yield a failure for each clause that the result of a path through `run` can violate."""
        for solver, result in paths(list(given.values()), run):
            found = clauses(result)
            self.obligations += len(found)
            if violation(solver, z3.simplify(z3.And(*found.values()))):
                for name, clause in found.items():
                    if model := violation(solver, clause):
                        yield Failure(name, known(model, values))


ZONED = z3.Bool("zones")
"""Whether there is any zone."""


class AnyRegion(Region):
    """Zones that bar anything, but the same again for the same question."""

    def __bool__(self) -> bool:
        return bool(Truth(ZONED))

    def why_inside(self, p: Point) -> str:
        return barred("inside", *p)

    def why_overlaps(self, box: Box) -> str:
        return barred("overlaps", *box[0], *box[1])


def barred(name: str, *numbers: object) -> str:
    function = z3.Function(name, *[FLOAT] * len(numbers), z3.BoolSort())
    return "barred" if Truth(z3.And(ZONED, function(*map(term, numbers)))) else ""


class AnyBox:
    """Box that may be missing."""

    def __init__(self) -> None:
        self._is_there = Truth()
        self._corners = tuple(tuple(Number() for _ in "xyz") for _ in "ab")

    def __bool__(self) -> bool:
        return bool(self._is_there)

    def __getitem__(self, corner: int) -> tuple[Number, ...]:
        return self._corners[corner]


class AnyOthers:
    """Other vehicles that may be too near the way to a goal, and too near a curve."""

    def __init__(self) -> None:
        self.near, self.bent = Found(), Found()


class Found(Truth):
    """Vehicles that are too near, if any."""

    def __getitem__(self, _number: int) -> Neighbour:
        return Neighbour("other", (), 1.0, 1.0, How.IS, clears=False)


def found_by(which: str) -> Callable[..., Any]:
    """Return a function that finds any vehicles, the same again in the same world.

    In one event, one way is verified.
    """

    def find(*arguments: Any) -> Any:
        others = arguments[-1].others if isinstance(arguments[-1], World) else arguments[-1]
        return getattr(others, which) if isinstance(others, AnyOthers) else []

    return find


def related(name: str, *numbers: object) -> Truth:
    """Return any truth value, the same again for the same numbers."""
    function = z3.Function(name, *[FLOAT] * len(numbers), z3.BoolSort())
    return Truth(function(*map(term, numbers)))


OPAQUE[Others] = lambda: iter((AnyOthers(),))
# A verdict is made from the situation and the world that a check meets.
OPAQUE[GoalVerdict] = lambda: iter((None,))
OPAQUE[Region] = lambda: iter((AnyRegion(),))
OPAQUE[Box | None] = lambda: iter((AnyBox(),))
# The zones themselves are read by Region alone.
OPAQUE[list[ZoneParams]] = lambda: iter(([],))


def somewhere(name: str, *numbers: object) -> Any:
    """Return any point, the same again for the same numbers."""
    return tuple(opaque(f"{name} {axis}", *numbers) for axis in "xyz")


def flat(*points: Point) -> list[float]:
    return [number for point in points for number in point]


def box_around(*points: Point) -> Box:
    numbers = flat(*points)
    low, high = (somewhere(f"{end} of {len(points)}", *numbers) for end in ("low", "high"))
    return low, high


def any_corners(*_: object) -> tuple[Point, ...]:
    """Return none, or one: a route has the goal after it, so its first point is taken from the rest."""
    return (next(unknown(Point)),) if Truth() else ()


def any_stops(_s: Situation, w: World) -> Box:
    """Return any box, the same again for the same place and speed."""
    about = (*w.place, *astuple(w.pose.velocity))
    return somewhere("lowest", *about), somewhere("highest", *about)


def any_result(name: str, *arguments: Any) -> Number:
    """Return any number for a function of `math`, the same again for the same numbers and points."""
    numbers = (each if isinstance(each, tuple) else (each,) for each in arguments)
    return opaque(name, *chain.from_iterable(numbers))


@contextmanager
def abstracted() -> Iterator[None]:
    """Replace the geometry by unknown numbers."""
    with pytest.MonkeyPatch.context() as patch:
        for owner in (automaton, motion, stopping):
            for name, thing in vars(owner).items():
                if callable(thing) and thing.__module__ == "math":
                    patch.setattr(owner, name, partial(any_result, name))
        for owner in (automaton, motion):
            patch.setattr(owner, "motion", lambda s: box_around(s.origin, s.goal))
        for owner in (motion, routes):
            for name in ("around", "bend"):
                patch.setattr(owner, name, box_around)
        patch.setattr(motion, "_stop_box", any_stops)
        # The words of a refusal alone depend on it there.
        patch.setattr(motion, "LOW", -inf)
        patch.setattr(motion, "too_near", found_by("near"))
        patch.setattr(motion, "conflicts", found_by("bent"))
        patch.setattr(motion, "space_of", lambda *_: ())
        patch.setattr(
            motion,
            "_is_near",
            lambda s, w: related("near", *flat(s.goal, w.place)),
        )
        patch.setattr(motion, "why_barred", lambda route, _: barred("way", *flat(*route.points)))
        patch.setattr(motion, "_why_zoned", lambda s, w: barred("rest", *flat(w.place, s.goal)))
        patch.setattr(motion, "way_around", any_corners)
        patch.setattr(motion, "isfinite", lambda number: Truth(finite(number)))
        patch.setattr(monitor, "Region", lambda _: AnyRegion())
        patch.setattr(monitor, "nearest", lambda *_: Nearest("any", Number()))  # type: ignore[arg-type]
        # The declared numbers may be any, so those of every other law, too.
        patch.setattr(StoppingLaw, "declared", lambda _law, *numbers: StoppingLaw(*numbers))
        for name in ("leeway", "stopping_excess"):
            patch.setattr(World, name, lambda _w, *_: Number())
        yield


@contextmanager
def summarized() -> Iterator[None]:
    """Replace `why_outside` by what `prove_cage` proves of it: one decision for its six."""
    with pytest.MonkeyPatch.context() as patch:
        for owner in (motion, monitor):
            patch.setattr(
                owner, "why_outside", lambda p, c: "" if Truth(inside(p, c)) else "outside"
            )
        yield


def finite(number: object) -> z3.BoolRef:
    return z3.Not(z3.Or(z3.fpIsNaN(term(number)), z3.fpIsInf(term(number))))


def inside(point: Point, cage: Cage) -> z3.BoolRef:
    """Return whether a point is in the cage, the walls included; NaN is not."""
    x, y, z = map(term, point)
    a, b, c = map(term, astuple(cage))
    return z3.And(-a <= x, x <= a, -b <= y, y <= b, term(0.0) <= z, z <= c)


def place(point: Point) -> z3.BoolRef:
    """Return whether a point is finite and not below the floor."""
    return z3.And(*map(finite, point), term(point[2]) >= term(0.0))


def same(a: Point, b: Point) -> z3.BoolRef:
    """Return whether two points are the same to the last bit."""
    return z3.And(*(term(x) == term(y) for x, y in zip(a, b, strict=True)))


TRUE, FALSE = z3.BoolVal(True), z3.BoolVal(False)


def invariant(s: Situation, cage: Cage, fresh: z3.BoolRef) -> Clauses:
    """Return the clauses that hold between any two events."""
    on, verified = term(s.cage_on), s.candidate is not None
    legal = z3.Implies(on, inside(s.goal, cage))
    later = s.paused.goal if s.paused else None
    resumable = z3.And(place(later), z3.Implies(on, inside(later, cage))) if later else TRUE
    cornered = z3.And(TRUE, *(z3.Implies(on, inside(c, cage)) for c in s.corners))
    return {
        "corners are places": z3.And(TRUE, *map(place, s.corners)),
        "corners are inside if the cage is on": z3.Implies(not verified, cornered),
        "a flight that has ended has no corners": z3.BoolVal(
            not s.corners or s.flies or s.paused is not None
        ),
        "never MOVING with the cage on and the goal outside": z3.Implies(s.state is MOVING, legal),
        "no setpoint outside with the cage on, but to brake": z3.Implies(
            not verified and not s.brake, legal
        ),
        "no setpoint that is no place, or below the floor, but to brake": z3.Implies(
            not s.brake, place(s.goal)
        ),
        "a pause alone has a flight to resume, and its goal is inside if the cage is on": z3.And(
            (s.paused is not None) is (s.phase is FlightPhase.PAUSED), resumable
        ),
        "nothing is verified in a pause": z3.BoolVal(not (verified and s.paused)),
        "nothing is verified or MOVING without a pose": z3.Implies(s.state is not HOVERING, fresh),
    }


def refusing(s: Situation, e: Event, w: World) -> str:
    """Return the limit that refuses the candidate at a check; empty if there is none."""
    if not isinstance(e, Check) or s.candidate is None:
        return ""
    return next((limit.__name__ for limit in motion.LIMITS if limit(s.candidate, s, w)), "")


def transition(s: Situation, e: Event, w: World, after: Situation, limit: str) -> Clauses:
    """Return the clauses that hold for an event, at which a `limit` may refuse the candidate."""
    check = isinstance(e, Check) and s.candidate is not None
    candidate, fresh = s.candidate.goal if s.candidate else s.goal, term(w.fresh)
    continues = z3.And(not s.brake, same(after.goal, s.goal))
    accepts = z3.And(check, same(after.end, candidate), fresh)
    turns = isinstance(e, Seen) and s.state is MOVING and bool(s.corners)
    cornered = z3.And(turns, same(after.goal, s.corners[0])) if turns else FALSE
    resumed = s.paused.goal if s.paused else s.goal
    resumes = z3.And(isinstance(e, Seen), bool(s.paused), same(after.goal, resumed), fresh)
    started = after.state is MOVING and s.state is HOVERING
    verdict = after.state is MOVING and s.state is VERIFYING and not s.flies
    braked = z3.BoolVal(after.state is HOVERING and after.brake and after.paused is None)
    ends = (Hold, Booted) if s.state is HOVERING and not s.paused else (Hold, Booted, Gone)
    ends = ends if s.state is HOVERING else (*ends, Halted)
    rests = isinstance(e, Seen) and s.state is HOVERING and s.phase is FlightPhase.STOPPING
    rested = z3.And(after.phase is FlightPhase.STOPPED, same(after.goal, w.place))
    again = s.beyond is not inf
    given: Any = w.others
    others = given if isinstance(given, AnyOthers) else None
    near, bent = (z3.And(check, others.near.term), others.bent.term) if others else (FALSE, FALSE)
    untaken = z3.Or(after.state is not MOVING, z3.And(s.flies, same(after.goal, s.goal)))
    leaves = (Seen, Gone, Hold, Booted, Toggle, Resized)
    return {
        "a vehicle is sent off only by an accepted goal, a resumed flight or a corner": z3.Implies(
            not after.brake, z3.Or(continues, accepts, resumes, cornered)
        ),
        "MOVING begins only by an accepted goal or a resumed flight, with a pose": z3.And(
            z3.Implies(started, resumes), z3.Implies(verdict, accepts)
        ),
        "a hold, a new boot, and a silence or halt of a flight stop it": z3.Implies(
            isinstance(e, ends), braked
        ),
        "without poses a flight brakes": z3.BoolVal(
            not isinstance(e, Lost) or s.state is HOVERING
            or (after.state is HOVERING and after.brake)
        ),
        "a pause ends with the next pose, a stop, a change of the cage or a goal": z3.Implies(
            z3.And(bool(s.paused), z3.Or(isinstance(e, leaves), z3.And(isinstance(e, Goto), fresh))),
            after.paused is None,
        ),
        "a stop ends at rest, at a pose that is no jump; one guard may stop it once more": z3.Implies(
            z3.And(
                rests, term(stopping.at_rest(w.pose)), z3.Not(term(automaton.jumped(s, e, w))),
            ),
            z3.Or(rested, z3.And(again, braked, term(after.beyond) == term(inf))),
        ),
        "a way too near another vehicle is not taken": z3.Implies(near, untaken),
        f"a goal is not taken that {limit or 'a limit'} refuses": z3.Implies(bool(limit), untaken),
        "a place inside is accepted, but for zones, other vehicles and further limits": z3.Implies(
            z3.And(
                check, z3.Not(ZONED), z3.Not(near), z3.Not(bent), place(candidate),
                limit in {"", motion.within_cage.__name__},
                z3.Or(z3.Not(term(s.cage_on)), inside(candidate, w.cage)),
            ),
            z3.And(after.state is MOVING, same(after.goal, candidate)),
        ),
    }  # fmt: skip


def step(s: Situation, e: Event, w: World) -> Situation:
    """Return the situation after an event, by the step of the monitor: a test may break it."""
    if isinstance(e, Check) and s.candidate is not None:
        e = Check(motion.verify(s, s.candidate, w))
    after: Situation = vars(monitor)["step"](s, e, w)
    return after


def prove_start(proof: Proof) -> Iterator[Failure]:
    """Check the situation that a monitor starts with."""
    for restarted in (False, True):
        (params,) = unknown(SafetyParams)
        size = next(unknown(CageSize))
        yield from proof.check(
            {},
            lambda: Monitor(params, print, restarted=restarted, grace=1.0).situation,  # noqa: B023
            lambda s: invariant(s, size, z3.BoolVal(False)),  # noqa: B023
            restarted,
        )


def prove_cage(proof: Proof) -> Iterator[Failure]:
    """Check that `why_outside` gives a reason exactly for the points that are not inside.

    It is that of its users, for whom `summarized` replaces it.
    """
    point, size = next(unknown(Point)), next(unknown(CageSize))
    for user in (motion, monitor):
        yield from proof.check(
            {},
            partial(user.why_outside, point, size),
            lambda reason: {"a reason is given outside alone": z3.Xor(bool(reason), inside(point, size))},
            point, size,
        )  # fmt: skip


def prove_step(proof: Proof, share: int = 0, shares: int = 1) -> Iterator[Failure]:
    """Check every event in every situation, or one of several shares of them."""
    with summarized():
        yield from _prove_step(proof, share, shares)


def _prove_step(proof: Proof, share: int, shares: int) -> Iterator[Failure]:
    pairs = product(list(unknown(Event)), list(situations()))
    for e, s in islice(pairs, share, None, shares):
        # After a guard has stopped the vehicle `beyond` is infinite, and stays so to the next cage.
        for before in (s, replace(s, beyond=inf)) if isinstance(e, Seen) else (s,):
            (w,) = unknown(World)
            yield from _prove_event(proof, before, e, w)


def situations() -> Iterator[Situation]:
    """Yield unknown situations of every shape that the invariant allows."""
    for s in unknown(Situation):
        pauses = s.phase is FlightPhase.PAUSED
        fits = pauses is (s.paused is not None) and not (pauses and s.candidate)
        if fits and (not s.corners or s.flies or pauses):
            yield s


def _prove_event(proof: Proof, before: Situation, e: Event, w: World) -> Iterator[Failure]:
    before_fresh, size = term(w.fresh), w.cage
    given: Clauses = {}
    if isinstance(e, Seen | Booted):
        before_fresh, given = z3.FreshBool(), {"news": term(w.fresh)}
    if isinstance(e, Resized):
        size = next(unknown(CageSize))
    after_fresh = z3.And(term(w.fresh), not isinstance(e, Lost))
    yield from proof.check(
        given | invariant(before, size, before_fresh),
        lambda: (step(before, e, w), refusing(before, e, w)),
        lambda found: invariant(found[0], w.cage, after_fresh) | transition(before, e, w, *found),
        before, e, w,
    )  # fmt: skip


class Told(NamedTuple):
    """Monitor before and after a call: its situation and freshness; the call's result."""

    s: Situation
    fresh: z3.BoolRef
    after: Monitor
    result: Any


Call = tuple[Callable[[Monitor], Any], Callable[[Told], Clauses]]


def calls(boot: str) -> Iterator[tuple[str, Call]]:
    """Yield each call of a monitor with unknown arguments, and what it ensures."""
    number: Any = Number()
    toggled: Any = Truth()
    reason = "any"
    goal, (pose,), (size,) = next(unknown(Position)), unknown(Pose), unknown(CageParams)
    yield "lose", (Monitor.lose, lost)
    ages: tuple[Any, ...] = (None, Number())
    for age in ages:
        watch = partial(Monitor.watch, newest=pose, age=age, setpoint_timeout=number)
        yield "watch", (watch, partial(watched, age))
    yield "silent", (lambda m: m.silent(number, number), partial(silenced, number))
    yield "lagged", (lambda m: m.lagged(reason, number), nothing)
    yield "halted", (lambda m: m.halted(reason), stopped)
    asked: dict[str, Any] = {"replace": Truth(), "takeoff": Truth(), "direct": Truth()}
    yield "goto", (lambda m: m.goto(goal, **asked), partial(answered, goal))
    yield "hold", (Monitor.hold, stopped)
    yield "set_landing", (lambda m: m.set_landing(reason), stopped if boot else nothing)
    while_landing = partial(_goto_while_landing, goal, asked)
    yield "goto while landing", (while_landing, partial(refused, goal))
    yield "toggle", (lambda m: m.toggle(cage_on=toggled), nothing)
    yield "resize", (partial(_resize, size), nothing)
    for seen_boot in dict.fromkeys((NEW, GONE, boot or NEW)):
        yield f"see a pose of {seen_boot}", (partial(_see, replace(pose, boot=seen_boot)), seen)


GONE, NOW, NEW = "a boot that is over", "the present boot", "a new boot"
"""Names of boots, and "" before the first; a boot has a name."""


def _see(pose: Pose, m: Monitor) -> tuple[Pose, bool]:
    """Return the new pose, and whether a pose of the boot before is ignored from now on."""
    before = m.pose
    m.see(pose)
    return pose, m.situation.boot == before.boot or m.ignores(replace(pose, boot=before.boot))


def _goto_while_landing(goal: Position, asked: dict[str, Any], m: Monitor) -> str:
    m._landing = "any"
    return m.goto(goal, **asked)


def _resize(size: CageParams, m: Monitor) -> None:
    m._params.virtual_cage = size
    m.resize()


def nothing(_told: Told) -> Clauses:
    return {}


def seen(told: Told) -> Clauses:
    pose, gone = told.result
    void = pose.boot == GONE
    return {
        "a pose of a boot that is over changes nothing": z3.Implies(
            void, z3.And(told.after.situation is told.s, told.after.pose is not pose)
        ),
        "a new boot ends the one before": z3.BoolVal(gone),
        "a pose that is taken may be relied on": z3.Implies(
            told.after.pose is pose, term(told.after.fresh)
        ),
    }


def stopped(told: Told) -> Clauses:
    s = told.after.situation
    return {"a stop brakes": z3.BoolVal(told.s.state is HOVERING or s.brake)}


def lost(told: Told) -> Clauses:
    return {"a lost pose is not relied on": z3.Not(term(told.after.fresh))}


def watched(age: Number | None, told: Told) -> Clauses:
    late = z3.BoolVal(False) if age is None else age.term > term(told.after._params.pose_timeout)
    return {f"a late pose: {name}": z3.Implies(late, clause) for name, clause in lost(told).items()}


def silenced(seconds: Number, told: Told) -> Clauses:
    limits = (told.after._grace, told.after._params.pose_timeout)
    over = z3.And(*(seconds.term > term(limit) for limit in limits))
    return {
        "a silence beyond the grace ends a flight and a pause": z3.Implies(
            over,
            z3.And(told.after.situation.state is HOVERING, told.after.situation.paused is None),
        )
    }


def answered(goal: Position, told: Told) -> Clauses:
    s, accepted, params = told.after.situation, told.result == "", told.after._params
    unchanged = z3.And(same(s.goal, told.s.goal), s.brake is told.s.brake)
    return {
        "a goal is accepted with a pose alone, and flown to": z3.Implies(
            z3.And(accepted, *map(finite, astuple(params.virtual_cage))),
            z3.And(told.fresh, s.state is MOVING, same(s.end, astuple(goal))),
        ),
        "a goal that is refused changes nothing": z3.Or(accepted, unchanged, s.brake),
    }


def refused(goal: Position, told: Told) -> Clauses:
    return {
        "a vehicle that lands takes no goal": z3.BoolVal(told.result != ""),
        **answered(goal, told),
    }


class Published(Situation, frozen=True):
    """Situation of a monitor that always publishes: it does nothing else if nothing changed."""

    def __eq__(self, _other: object) -> bool:
        return False

    __hash__ = None  # type: ignore[assignment]


class Reports:
    """Tracking monitor that may report anything."""

    def observe(self, *_pose: object, **_moving: object) -> tuple[Number, Truth]:
        return Number(), Truth()


def prove_monitor(proof: Proof, share: int = 0, shares: int = 1) -> Iterator[Failure]:
    """Check every call of a monitor, or one of several shares of its situations.

    Between two calls nothing is being verified.
    """
    with summarized():
        yield from _prove_monitor(proof, share, shares)


def _prove_monitor(proof: Proof, share: int, shares: int) -> Iterator[Failure]:
    for s, boot in islice(product(list(situations()), (NOW, "")), share, None, shares):
        if s.candidate or (not boot and (s.paused or s.flies)):
            continue
        before = Published(**asdict(s) | {"boot": boot, "reason": "earlier"})
        (params,) = unknown(SafetyParams)
        (pose,), (last,), fresh, grace = unknown(Pose), unknown(Pose), Truth(), Number()
        restarted = Truth()
        for name, (act, ensures) in calls(boot):

            def run() -> Told:
                m = Monitor(copy(params), lambda *_: None, restarted=restarted, grace=grace)  # type: ignore[arg-type] # noqa: B023
                m.situation, m.fresh, m.tracking = before, fresh, Reports()  # type: ignore[assignment] # noqa: B023
                m.pose, m._last = (replace(each, boot=boot) for each in (pose, last))  # noqa: B023
                m._void |= {GONE}
                return Told(before, fresh.term, m, act(m))  # noqa: B023

            def clauses(told: Told) -> Clauses:
                after, setpoint = told.after, told.after.setpoint()
                sent = same(astuple(setpoint.position), after.situation.goal)
                brakes = setpoint.brake is after.situation.brake
                return {
                    "nothing is being verified between two calls": z3.BoolVal(
                        after.situation.state is not VERIFYING
                    ),
                    "the setpoint is that of the situation": z3.And(sent, brakes),
                    "before the first boot no pose is relied on, and nothing flies": z3.Or(
                        bool(after.situation.boot),
                        z3.And(
                            z3.Not(term(after.fresh)),
                            after.situation.state is HOVERING,
                            after.situation.paused is None,
                        ),
                    ),
                    **invariant(after.situation, after._params.virtual_cage, term(after.fresh)),
                    **ensures(told),  # noqa: B023
                }

            given = invariant(before, params.virtual_cage, fresh.term)
            given |= {"before the first boot": z3.Or(bool(boot), z3.Not(fresh.term))}
            yield from proof.check(given, run, clauses, before, name, params)
