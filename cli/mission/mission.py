"""A mission file: requests to the vehicle, each at a simulated time. Pure.

end = 12.0
rows = [
{ at = 2.5, do = "goto", x = 1.0, y = 2.0, z = 1.0 },
{ at = 3.0, do = "param", name = "safety.virtual_cage.x", value = 3.0 },
]
[set]
dynamics.start.z = 1.0
"""

import re
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from quadctl.schemas.params import Params
from quadctl.schemas.services import (
    CalibrateRequest,
    GotoRequest,
    HoldRequest,
    SetParamsRequest,
    ToggleCageRequest,
)
from quadctl.schemas.topics import (
    CALIBRATE,
    GOTO,
    HOLD,
    TOGGLE_CAGE,
    Service,
    own_service,
    set_params,
)
from quadctl.schemas.typed import converted
from quadctl.schemas.units import Metres
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params import catalogue
from quadctl.services.runtime.params.load import check, check_value
from quadctl.services.runtime.params.names import flatten, nearest, normal_name, put

NODES = ("dynamics", "pressure", "safety")
"""Nodes that take part in a mission, with the tables of their parameters."""

AFTER = 5.0
"""Simulated s from the last row to the end of a mission without an `end`."""
_MOST = 5_000  # rows of a mission: no more than the calls of a service that may wait

Time = Annotated[float, Meta(ge=0, le=86_400)]
"""Simulated s since the start of the boot."""


class GotoStep(Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag="goto"):
    """Request for a goal, m; with `replace` also in flight."""

    at: Time
    x: Metres
    y: Metres
    z: Metres
    replace: bool = False

    def call(self) -> tuple[Service[Any, Any], Struct]:
        """Return the service and its request."""
        return GOTO, GotoRequest(self.x, self.y, self.z, self.replace)

    def __str__(self) -> str:
        return f"goto {self.x:g} {self.y:g} {self.z:g}{' --replace' if self.replace else ''}"


class CageStep(Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag="cage"):
    """Switch of the cage, on or off."""

    at: Time
    on: bool

    def call(self) -> tuple[Service[Any, Any], Struct]:
        """Return the service and its request."""
        return TOGGLE_CAGE, ToggleCageRequest(self.on)

    def __str__(self) -> str:
        return f"cage {'on' if self.on else 'off'}"


class HoldStep(Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag="hold"):
    """Stop, to hover at the stopping point."""

    at: Time

    def call(self) -> tuple[Service[Any, Any], Struct]:
        """Return the service and its request."""
        return HOLD, HoldRequest()

    def __str__(self) -> str:
        return "hold"


class Calibrate(Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag="calibrate"):
    """Zeroing of the barometer; with `unset`, loss of its baseline."""

    at: Time
    unset: bool = False

    def call(self) -> tuple[Service[Any, Any], Struct]:
        """Return the service and its request."""
        return CALIBRATE, CalibrateRequest(not self.unset)

    def __str__(self) -> str:
        return f"calibrate{' --unset' if self.unset else ''}"


class ParamStep(Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag="param"):
    """Change of a parameter, or of several in one table."""

    at: Time
    name: str
    value: Any

    @property
    def values(self) -> dict[str, Any]:
        """Return the new values by full dotted name."""
        return dict(flatten({normal_name(self.name): self.value}))

    def call(self) -> tuple[Service[Any, Any], Struct]:
        """Return the service and its request."""
        return set_params(normal_name(self.name).partition(".")[0]), SetParamsRequest(self.values)

    def __str__(self) -> str:
        return f"param set {self.name} {catalogue.word(self.value)}"


class CallStep(Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag="call"):
    """Call of a service of one's own: `own/NAME`, or its type's name, e.g. `Charge`."""

    at: Time
    service: Annotated[str, Meta(pattern=r"^(own(/[A-Za-z0-9_-]+)+|[A-Z][A-Za-z0-9]*)$")]
    request: dict[str, Any] = {}

    @property
    def type_name(self) -> str:
        """Return the name of the type by which the service is called; empty if it is called by its own."""
        return "" if "/" in self.service else self.service

    def call(self) -> tuple[Service[Any, Any], Any]:
        """Return the service and its request."""
        return own_service(self.service), self.request

    def __str__(self) -> str:
        words = (f"{name}={catalogue.word(value)}" for name, value in self.request.items())
        return " ".join((f"call {self.service}", *words))


Row = GotoStep | CageStep | HoldStep | Calibrate | ParamStep | CallStep
KINDS: dict[str, Any] = {
    "goto": GotoStep,
    "cage": CageStep,
    "hold": HoldStep,
    "calibrate": Calibrate,
    "param": ParamStep,
    "call": CallStep,
}
"""Kinds of rows, by their `do`."""


class MissionFile(Struct, frozen=True):
    """Rows in the order of their times, equal ones as in the file, and the time (s) of its end.

    With `params` the mission flies in a run of its own, launched with them.
    """

    rows: list[Row]
    end: float
    params: Params | None = None


class _File(Struct, forbid_unknown_fields=True):
    rows: Annotated[list[dict[str, Any]], Meta(min_length=1, max_length=_MOST)]
    end: Time | None = None
    settings: dict[str, Any] | None = msgspec.field(name="set", default=None)


def mission(tables: dict[str, Any], source: str) -> MissionFile:
    """Return the mission in a file's tables; raise Invalid, which names the row or the setting."""
    try:
        file = converted(tables, _File)
    except msgspec.ValidationError as error:
        swallowed = isinstance(tables.get("set"), dict) and "rows" in tables["set"]
        raise Invalid(
            f"{source}: {_plain(error)}",
            "all that follows [set] belongs to it: move `rows` and `end` above it"
            if swallowed
            else 'a mission is `end = 12.0` and `rows = [{ at = 2.5, do = "goto", x = 1.0, ... }]`',
        ) from error
    rows = [_row(table, f"{source}: row {number}") for number, table in enumerate(file.rows, 1)]
    last = max(row.at for row in rows)
    if file.end is not None and file.end < last:
        raise Invalid(
            f"{source}: end = {file.end:g}: the last row is at {last:g} s", "set a later `end`"
        )
    end = last + AFTER if file.end is None else file.end
    params = None if file.settings is None else params_of(file.settings, f"{source}: [set]")
    return MissionFile(sorted(rows, key=lambda row: row.at), end, params)


def params_of(settings: dict[str, Any], place: str) -> Params:
    """Return the parameters of a run of its own: as fast as it goes, unless the settings differ.

    Raises Invalid for an unknown parameter, a bad value, one of the run and not of a vehicle, and for a
    run that would not be in lock-step.
    """
    tables: dict[str, Any] = {"dynamics": {"speed": 0.0}}
    seen: set[str] = set()
    for name, value in flatten(settings):
        known = normal_name(name)
        _refuse_run(known, place)
        if known in seen:
            raise Invalid(f"{place}: {known} is set twice", "leave one of the two")
        seen.add(known)
        put(tables, known, value, place)
    params = check(tables, place)
    if "dynamics.lockstep" not in seen:
        params.dynamics.lockstep = params.dynamics.speed == 1  # at any other it is anyway
    if not params.dynamics.in_lockstep:
        raise Invalid(f"{place}: dynamics.lockstep: a mission flies in lock-step", "leave it out")
    return params


def _refuse_run(name: str, place: str) -> None:
    table = name.partition(".")[0]
    if table in Params.__struct_fields__ and table not in NODES:
        raise Invalid(
            f"{place}: {name} is fixed at launch, and belongs to the run, not to the vehicle",
            f"`quadctl up --set {name}=...`, and fly a mission without [set] in it",
        )


def _row(table: dict[str, Any], place: str) -> Row:
    do = table.get("do", "")
    if str(do) not in KINDS:
        what = f"do = {do!r} is no command" if "do" in table else "`do` is missing"
        known = f"use one of {', '.join(KINDS)}"
        raise Invalid(f"{place}: {what}", nearest(str(do), KINDS) or known)
    kind = KINDS[do]
    try:
        row: Row = converted(table, kind)
    except msgspec.ValidationError as error:
        unknown = next((name for name in table if name not in {"do", *kind.__struct_fields__}), "")
        hint = nearest(unknown, kind.__struct_fields__) if unknown else ""
        fields = ", ".join(kind.__struct_fields__)
        raise Invalid(f"{place}: {_plain(error)}", hint or f"{do} takes {fields}") from error
    if isinstance(row, ParamStep):
        _check_values(row, place)
    return row


def _check_values(row: ParamStep, place: str) -> None:
    for name, value in row.values.items():
        _refuse_run(name, place)
        check_value(name, value, place)
        if catalogue.fixed_at_launch(name):
            switch = 'use a row with `do = "cage"`, or ' if catalogue.live_switch(name) else ""
            raise Invalid(f"{place}: {name} is fixed at launch", f"{switch}set it under [set]")


def _plain(error: msgspec.ValidationError) -> str:
    """Return `x: expected float, got str` from msgspec's own words."""
    what, _, where = str(error).partition(" - at `$")
    name = re.sub(r"\[\.{3}\]", "", where.rstrip("`")).lstrip(".")
    text = (what[:1].lower() + what[1:]).replace("`", "")
    return f"{name}: {text}" if name else text
