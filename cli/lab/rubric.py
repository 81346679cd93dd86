"""Rubric: rows that each fly a mission against a student's nodes, and the points they give. Pure.

[[row]]
name = "refuses a goal outside"
points = 2.0
hint = "compare all three coordinates"
rows = [{ at = 3.0, do = "goto", x = 9.0, y = 0.0, z = 1.0 }]
expect = "refused"
"""

from collections.abc import Iterator, Sequence
from random import Random
from typing import Annotated, Any, Literal, NamedTuple, get_args

import msgspec
from msgspec import Meta, Struct

from quadctl.cli.mission.mission import (
    CageStep,
    Calibrate,
    CallStep,
    GotoStep,
    MissionFile,
    Row,
    Time,
    mission,
    params_of,
)
from quadctl.schemas.messages import StateName
from quadctl.schemas.topics import SERVICES
from quadctl.schemas.typed import converted
from quadctl.schemas.units import Metres
from quadctl.services.runtime.errors import Invalid, UsageError
from quadctl.services.runtime.params.names import nearest

Expectation = Literal[
    "refused", "arrives", "transitions", "answers_in_flight", "stays_inside", "stops", "answers",
    "zeroed", "parameter_obeyed", "state_seen", "prints", "takes_waypoints", "replies",
    "random_flights",
]  # fmt: skip
_FLIES = {"random_flights"}
"""Expectations that fly missions of their own."""


class Expected(NamedTuple):
    """Condition of a flight as expected; `keys` has those beside the keys of every row, with their defaults."""

    holds: str
    keys: dict[str, str]


EXPECTATIONS: dict[Expectation, Expected] = {
    "refused": Expected(
        "the last goal is refused by the verification: safety is HOVERING when it comes, shows"
        " VERIFYING and HOVERING again, never sends the vehicle there, and the vehicle stays; each"
        " goal before it was accepted and reached",
        {"within": "0.3 m"},
    ),
    "arrives": Expected(
        "the last goal is accepted, safety is MOVING until the vehicle is within the acceptance"
        " range and HOVERING then, and at the end the vehicle is there; with `each` so it is with"
        " every goal, before the next one comes",
        {"within": "the acceptance range", "each": "`false`"},
    ),
    "transitions": Expected(
        "on the last goal safety shows HOVERING, VERIFYING, MOVING and HOVERING, in this order and"
        " no other",
        {},
    ),
    "answers_in_flight": Expected(
        "the last goal, which comes on the way to another, is refused with a reason and the other"
        " reached, or accepted and reached",
        {"within": "the acceptance range"},
    ),
    "stays_inside": Expected(
        "the true position never leaves the cage in force", {"within": "the margin in force"}
    ),
    "stops": Expected(
        "the vehicle is on its way when the cage comes on, does not leave the cage, and comes to"
        " rest; a later goal is accepted and reached",
        {},
    ),
    "answers": Expected(
        "each request has an answer, and each refusal a reason; of the goals outside at least one"
        " is refused; a baseline is the air's pressure. Before the first reading of a flight"
        " `calibrate` may be refused. With `service` the calls of this service alone are judged",
        {"service": "all", "within": "1 hPa"},
    ),
    "zeroed": Expected(
        "after each `calibrate`, until the next, the readings are the change of the air's pressure"
        " with the height flown since; after one with `unset` they are the air's pressure, to 1 hPa,"
        " and the reply has the baseline 0",
        {"within": "0.01 hPa"},
    ),
    "parameter_obeyed": Expected(
        "each goal gets the verdict of the cage that `set` and the mission command, and each"
        " refusal is one as for `refused`",
        {},
    ),
    "state_seen": Expected("safety publishes this state", {"state": 'e.g. `"MOVING"`'}),
    "prints": Expected(
        "each line is, from the node's start on, in a line of its log; the form of numbers and"
        " spaces does not count",
        {"lines": "a list of texts", "node": '`"safety"`'},
    ),
    "takes_waypoints": Expected(
        "for each waypoint that the cage permits safety shows VERIFYING, MOVING and HOVERING, and"
        " the vehicle gets there before the next; for each other one it shows VERIFYING and"
        " HOVERING, and the vehicle stays",
        {
            "waypoints": "a list of `{ at, x, y, z }`, with a later time each",
            "within": "the acceptance range",
        },
    ),
    "replies": Expected(
        "the reply to the last `call` has these fields with these values",
        {"reply": "`{}`", "node": '`"safety"`', "within": "0, of numbers"},
    ),
    "random_flights": Expected(
        "in random missions of the campaign no goal is wrongly answered, and the vehicle does not"
        " leave the cage",
        {
            "flights": "`20`",
            "seed": "`7`, of a hidden row that of the class",
            "seconds": "`15.0`, of a flight",
        },
    ),
}
_MOST_ROWS = 200


class WaypointStep(Struct, frozen=True, forbid_unknown_fields=True):
    """Goal (m) that is published on input/position_request, from a simulated time (s) on."""

    at: Time
    x: Metres
    y: Metres
    z: Metres

    def __str__(self) -> str:
        return f"waypoint {self.x:g} {self.y:g} {self.z:g}"


class RubricRow(Struct, frozen=True, forbid_unknown_fields=True):
    """Row: a mission (with its own end and parameters), an expectation, and points.

    `within` is in m, for `answers` and `zeroed` in hPa; 0 means the default of the expectation.
    """

    name: Annotated[str, Meta(min_length=1, max_length=120, description="what the row tests")]
    expect: Annotated[Expectation, Meta(description="one of the expectations below")]
    points: Annotated[
        float, Meta(ge=0, le=1000, description="points if the flight is as expected, else none")
    ] = 1.0
    number: Annotated[str, Meta(description="number in the report; else its place")] = ""
    visible: Annotated[bool, Meta(description="`lab check` flies the row too")] = True
    hint: Annotated[str, Meta(description="shown with a row that fails")] = ""
    rows: Annotated[
        list[dict[str, Any]],
        Meta(
            description="the flight, as in a mission. A number may be `[low, high]`, and a step"
            " `optional = true`: both are drawn, by `lab grade` from its seed, by `lab check` always"
            " the same"
        ),
    ] = []
    end: Annotated[
        float | None, Meta(description="end of the flight, s; else 5 s after the last row")
    ] = None
    set: Annotated[
        dict[str, Any], Meta(description="parameters of the launch, as `[set]` of a mission")
    ] = {}
    within: Annotated[float, Meta(ge=0)] = 0.0
    service: str = ""
    state: Literal["", "HOVERING", "VERIFYING", "MOVING"] = ""
    each: bool = False
    node: Literal["", "safety", "pressure"] = ""
    lines: list[Annotated[str, Meta(min_length=1)]] = []
    waypoints: list[WaypointStep] = []
    reply: dict[str, Any] = {}
    flights: Annotated[int, Meta(ge=1, le=1000)] = 20
    seed: Annotated[int, Meta(ge=0)] = 7
    seconds: Annotated[float, Meta(gt=0, le=600)] = 15.0

    @property
    def about(self) -> str:
        """Return the node that the row is about: a row without that node of the student gives 0."""
        of_pressure = self.expect == "zeroed" or self.service in _OF_PRESSURE
        return self.node or ("pressure" if of_pressure else "safety")


_COMMON = {*RubricRow.__struct_fields__}.difference(*(each.keys for each in EXPECTATIONS.values()))
_OF_PRESSURE = {"calibrate_pressure"}


class RowVerdict(NamedTuple):
    """Verdict on a row, and the evidence for it in one sentence."""

    ok: bool
    output: str


class _File(Struct, forbid_unknown_fields=True):
    row: Annotated[list[dict[str, Any]], Meta(min_length=1, max_length=_MOST_ROWS)]


class Rubric(Struct, frozen=True):
    """Rows in the order of the file, each with its mission: empty for one that flies at random."""

    rows: list[RubricRow]
    missions: list[MissionFile]

    @property
    def points(self) -> float:
        """Return the points of all rows."""
        return sum(row.points for row in self.rows)


def rubric(tables: dict[str, Any], source: str) -> Rubric:
    """Return the rubric in a file's tables; raise Invalid, which names the row and the key."""
    try:
        file = converted(tables, _File)
    except msgspec.ValidationError as error:
        raise Invalid(
            f"{source}: {error}",
            "a rubric is a list of tables [[row]]: `quadctl lab new` writes one",
        ) from error
    rows = [_row(table, number, source) for number, table in enumerate(file.row, 1)]
    names = [row.name for row in rows]
    for name in names:
        if names.count(name) > 1:
            raise Invalid(f"{source}: two rows have the name {name!r}", "give each its own")
    return Rubric(rows, [_mission(row, f"{source}: row {row.name!r}") for row in rows])


def drawn(tables: dict[str, Any], seed: int) -> dict[str, Any]:
    """Return a rubric's tables with all that is left to chance drawn from a seed.

    That are a step's numbers in brackets, its presence if it is `optional`, and hidden flights at random
    without a seed of their own. A row's draws depend on its name and the seed alone.
    """
    return {"row": [_drawn(row, seed) for row in tables["row"]]}


def _drawn(row: dict[str, Any], seed: int) -> dict[str, Any]:
    if row.get("expect") in _FLIES and row.get("visible") is False and "seed" not in row:
        return row | {"seed": seed}
    return row | {"rows": _steps(row["name"], row["rows"], seed)} if row.get("rows") else row


def _steps(name: str, steps: Sequence[dict[str, Any]], seed: int) -> list[dict[str, Any]]:
    draw = Random(f"{seed} {name}")
    drawn = [(draw.random(), {key: _number(x, draw) for key, x in step.items()}) for step in steps]
    # Removed from each that is left, too: no mission knows it.
    return [step for chance, step in drawn if not step.pop("optional", False) or chance < _HALF]


_HALF = 0.5


def _number(value: Any, draw: Random) -> Any:
    low, high = _end(value, 0), _end(value, 1)
    return value if low is value else round(draw.uniform(low, high), 2)


def _end(value: Any, end: int) -> Any:
    """Return the lower or the higher end of a range; any other value as it is."""
    match value:
        case [int() | float(), int() | float()]:
            return value[end]
    return value


def visible(tables: dict[str, Any]) -> dict[str, Any]:
    """Return a rubric's tables without the rows that students do not see."""
    return {"row": [row for row in _numbered(tables) if row.get("visible") is not False]}


def selected(tables: dict[str, Any], numbers: Sequence[str]) -> dict[str, Any]:
    """Return a rubric's tables with the rows of these numbers alone; raise UsageError for an unknown one."""
    rows = _numbered(tables)
    known = [row["number"] for row in rows]
    for number in numbers:
        if number not in known:
            hint = nearest(number, known) or f"one of {', '.join(known)}"
            raise UsageError(f"--row {number}: the rubric has no such row", hint)
    return {"row": [row for row in rows if row["number"] in numbers]}


def _numbered(tables: dict[str, Any]) -> list[dict[str, Any]]:
    """Return a rubric's rows, each with its number: that of its place, unless it has one."""
    return [{"number": str(place)} | row for place, row in enumerate(tables["row"], 1)]


def _row(table: dict[str, Any], number: int, source: str) -> RubricRow:
    place = f"{source}: row {table.get('name', number)!r}"
    for name in table:
        known = [*RubricRow.__struct_fields__]
        if name not in known:
            raise Invalid(f"{place}: there is no key {name}", nearest(name, known))
    try:
        row = converted({"number": str(number)} | table, RubricRow)
    except msgspec.ValidationError as error:
        hint = f"it takes {', '.join(sorted(_COMMON))}"
        for name, allowed in (("expect", [*EXPECTATIONS]), ("state", get_args(StateName))):
            if f"`$.{name}`" in str(error):
                near = nearest(str(table[name]), allowed)
                hint = f"{near}{' ' * bool(near)}{name} is one of {', '.join(allowed)}"
        raise Invalid(f"{place}: {error}", hint) from error
    takes = EXPECTATIONS[row.expect].keys
    for name in table:
        if name not in _COMMON.union(takes):
            also = (
                f" beside those of every row it takes {', '.join(sorted(takes))}" if takes else ""
            )
            raise Invalid(f'{place}: expect = "{row.expect}" takes no {name}', also.strip())
    return row


def _mission(row: RubricRow, place: str) -> MissionFile:
    """Return the mission of a row; raise Invalid for one that cannot show what the row expects."""
    if row.expect in _FLIES:
        if row.rows:
            raise Invalid(f"{place}: {row.expect} flies missions of its own", "leave out `rows`")
        return MissionFile([], 0.0, params_of(row.set, place))
    if row.expect == "takes_waypoints":
        return _of_waypoints(row, place)
    for step in row.rows:
        if not isinstance(step.get("optional", False), bool):
            raise Invalid(f"{place}: optional = {step['optional']!r}", "it is true or false")
        for name, value in step.items():
            if _end(value, 0) is not value and value[0] > value[1]:
                raise Invalid(f"{place}: {name} = {value}", "the lower number comes first")
    # What is valid must not depend on what is drawn.
    made = [
        _flight(row, steps, place)
        for steps in (*_extremes(row.rows), _steps(row.name, row.rows, 0))
    ]
    return made[-1]


def _flight(row: RubricRow, steps: Sequence[dict[str, Any]], place: str) -> MissionFile:
    tables = {"rows": steps, "set": row.set} | ({} if row.end is None else {"end": row.end})
    if row.rows and not steps:
        raise Invalid(f"{place}: each of its steps is optional", "leave one without")
    made = mission(tables, place)
    _require_service(row, made, place)
    if lacks := _lacks(row, made):
        raise Invalid(f"{place}: {row.expect} needs {lacks}", f"see {_EXPECTATIONS}")
    return made


def _extremes(steps: Sequence[dict[str, Any]]) -> Iterator[list[dict[str, Any]]]:
    """Yield a flight at both ends of its ranges, without its optional steps and with them."""
    for with_all in (False, True):
        left = [step for step in steps if with_all or not step.get("optional")]
        for end in (0, 1):
            yield [
                {name: _end(value, end) for name, value in step.items() if name != "optional"}
                for step in left
            ]


def _require_service(row: RubricRow, made: MissionFile, place: str) -> None:
    services = [service.name for service in SERVICES]
    if row.service and row.service not in services:
        raise Invalid(f"{place}: there is no service {row.service}", nearest(row.service, services))
    if row.service and not any(step.call()[0].name == row.service for step in made.rows):
        raise Invalid(f"{place}: no row of its mission calls {row.service}", "add one to `rows`")


def _lacks(row: RubricRow, made: MissionFile) -> str:
    """Return what a row needs to show what it expects; empty if it has all."""
    kinds = [type(step) for step in made.rows]
    needs = {
        "prints": ('lines, e.g. ["Param: cage x - [-5, 5]"]', row.lines),
        "replies": ("a call among its `rows`", CallStep in kinds),
        "state_seen": ('a state, e.g. "VERIFYING"', row.state),
        "answers_in_flight": ("two goals in its `rows`", kinds.count(GotoStep) > 1),
        "stops": (
            "a goto and then a cage with on = true in its `rows`",
            _shuts_in_flight(made.rows),
        ),
        "zeroed": ("a calibrate among its `rows`", Calibrate in kinds),
        **dict.fromkeys(_GOES, ("a goto among its `rows`", GotoStep in kinds)),
    }
    what, has = needs.get(row.expect, ("", True))
    return "" if has else what


_GOES = ("refused", "arrives", "transitions", "parameter_obeyed")
"""Expectations about a goal."""
_EXPECTATIONS = "docs/reference/files.md#expectations"


def _of_waypoints(row: RubricRow, place: str) -> MissionFile:
    if row.rows or not row.waypoints:
        raise Invalid(f"{place}: takes_waypoints needs `waypoints`, and takes no `rows`")
    times = [each.at for each in row.waypoints]
    if row.end is None or [*times, row.end] != sorted({*times, row.end}):
        raise Invalid(f"{place}: each waypoint needs a later time, and `end` one after the last")
    return MissionFile([], row.end, params_of(row.set, place))


def _shuts_in_flight(steps: Sequence[Row]) -> bool:
    """Return whether a goal comes before the last command that turns the cage on."""
    goals = [n for n, step in enumerate(steps) if isinstance(step, GotoStep)]
    shut = [n for n, step in enumerate(steps) if isinstance(step, CageStep) and step.on]
    return bool(goals and shut) and goals[0] < shut[-1]
