"""Requests and responses of the services, the call envelope and the error reply."""

from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

from quadctl.schemas.units import Boot, Hectopascals, Metres, Seconds, Text

ErrorCode = Literal["invalid", "refused", "not_ready", "expired", "internal"]


class Error(Struct, frozen=True):
    """Error reply: the problem, and a hint."""

    code: ErrorCode
    message: str
    hint: str = ""


class Call(Struct, frozen=True):
    """Attachment of a query: executed once by `id`, and never after `deadline` (Unix time, s).

    With `at` (simulated s) the server holds the call, and executes and answers it at the first pose
    of that time or later that it steps on, of the named `boot`, by default the current one. A call
    for an earlier time or boot is not executed. A `reset` starts the boot that it names.
    """

    id: Annotated[str, Meta(min_length=1, max_length=64)]
    deadline: Annotated[float, Meta(ge=0, le=1e12)]
    at: Seconds | None = None
    boot: Boot = ""


class CalibrateRequest(Struct, frozen=True, forbid_unknown_fields=True):
    """Zero the barometer at the mean of the last second; with false, undo it."""

    zero: bool


class CalibrateResponse(Struct, frozen=True):
    """The present baseline, hPa; 0 after `zero = false`."""

    baseline: Hectopascals


class ToggleCageRequest(Struct, frozen=True, forbid_unknown_fields=True):
    """Turn the cage on or off."""

    cage_on: bool


class ToggleCageResponse(Struct, frozen=True):
    """True once the cage is as requested."""

    success: bool


class GotoRequest(Struct, frozen=True, forbid_unknown_fields=True):
    """Fly to a point, m, ENU; with `replace` also while another goal is being flown.

    With `direct` the way is the straight one, never one around zones. With `wait` a goal waits for
    other vehicles that fly too near its way.
    """

    x: Metres
    y: Metres
    z: Metres
    replace: bool = False
    direct: bool = False
    wait: bool = False


class GotoResponse(Struct, frozen=True):
    """Safety's verdict; `reason` is empty when accepted, or begins with `waits`."""

    accepted: bool
    reason: Text


class HoldRequest(Struct, frozen=True, forbid_unknown_fields=True):
    """Stop and hover at the stopping point."""


class HoldResponse(Struct, frozen=True):
    """True once the stop is commanded."""

    success: bool


class ResetRequest(Struct, frozen=True, forbid_unknown_fields=True):
    """Put the vehicle back at its start: a new boot."""


class ResetResponse(Struct, frozen=True):
    """True once the vehicle is at its start."""

    success: bool


class GetParamsRequest(Struct, frozen=True, forbid_unknown_fields=True):
    """Names, e.g. `safety.virtual_cage.x` or a whole table; none requests all of the node's."""

    names: Annotated[list[Text], Meta(max_length=1_000)]


class GetParamsResponse(Struct, frozen=True, omit_defaults=True):
    """Every requested value, by its full dotted name, as last set.

    For values that wait for the next standstill, `in_force` has the present ones.
    """

    values: dict[str, Any]
    in_force: dict[str, Any] = {}


class SetParamsRequest(Struct, frozen=True, forbid_unknown_fields=True):
    """New values by full dotted name: all are taken or none."""

    values: Annotated[dict[Text, Any], Meta(max_length=1_000)]


class SetParamsResponse(Struct, frozen=True, omit_defaults=True):
    """Success, or a refusal's or a wait's reason; `waits` names values waiting for a standstill."""

    success: bool
    reason: Text
    waits: list[str] = []
