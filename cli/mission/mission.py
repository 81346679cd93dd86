"""A mission file: requests to the vehicle, each at a simulated time. Pure.

end = 12.0
rows = [
{ at = 2.5, do = "goto", x = 1.0, y = 2.0, z = 1.0 },
{ at = 3.0, do = "cage", on = false },
]
"""

import re
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from quadctl.schemas.services import CalibrateRequest, GotoRequest, HoldRequest, ToggleCageRequest
from quadctl.schemas.topics import CALIBRATE, GOTO, HOLD, TOGGLE_CAGE, Service
from quadctl.schemas.units import Metres
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params.names import nearest

AFTER = 5.0
"""Simulated s from the last row to the end of a mission without an `end`."""
_MOST = 5_000  # rows of a mission: fewer than the calls that a node holds

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


Row = GotoStep | CageStep | HoldStep | Calibrate
_KINDS = {"goto": GotoStep, "cage": CageStep, "hold": HoldStep, "calibrate": Calibrate}


class MissionFile(Struct, frozen=True):
    """Rows in the order of their times, equal ones as in the file, and the time (s) of its end."""

    rows: list[Row]
    end: float


class _File(Struct, forbid_unknown_fields=True):
    rows: Annotated[list[dict[str, Any]], Meta(min_length=1, max_length=_MOST)]
    end: Time | None = None


def mission(tables: dict[str, Any], source: str) -> MissionFile:
    """Return the mission in a file's tables; raise Invalid, which names the row."""
    try:
        file = msgspec.convert(tables, _File)
    except msgspec.ValidationError as error:
        raise Invalid(
            f"{source}: {_plain(error)}",
            'a mission is `end = 12.0` and `rows = [{ at = 2.5, do = "goto", x = 1.0, ... }]`',
        ) from error
    rows = [_row(table, f"{source}: row {number}") for number, table in enumerate(file.rows, 1)]
    last = max(row.at for row in rows)
    if file.end is not None and file.end < last:
        raise Invalid(
            f"{source}: end = {file.end:g}: the last row is at {last:g} s", "set a later `end`"
        )
    end = last + AFTER if file.end is None else file.end
    return MissionFile(sorted(rows, key=lambda row: row.at), end)


def _row(table: dict[str, Any], place: str) -> Row:
    do = table.get("do", "")
    if str(do) not in _KINDS:
        what = f"do = {do!r} is no command" if "do" in table else "`do` is missing"
        known = f"use one of {', '.join(_KINDS)}"
        raise Invalid(f"{place}: {what}", nearest(str(do), _KINDS) or known)
    kind = _KINDS[do]
    try:
        row: Row = msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        unknown = next((name for name in table if name not in {"do", *kind.__struct_fields__}), "")
        hint = nearest(unknown, kind.__struct_fields__) if unknown else ""
        fields = ", ".join(kind.__struct_fields__)
        raise Invalid(f"{place}: {_plain(error)}", hint or f"{do} takes {fields}") from error
    return row


def _plain(error: msgspec.ValidationError) -> str:
    """Return `x: expected float, got str` from msgspec's own words."""
    what, _, where = str(error).partition(" - at `$")
    name = re.sub(r"\[\.{3}\]", "", where.rstrip("`")).lstrip(".")
    text = (what[:1].lower() + what[1:]).replace("`", "")
    return f"{name}: {text}" if name else text
