"""Parameters of a running node: get, set, and the file of its values, which only it writes."""

from collections.abc import Callable, Mapping
from typing import Any

import msgspec
from msgspec import Struct

from quadctl.schemas.params import FIXED_AT_LAUNCH, FROM_STANDSTILL, LIVE_SWITCHES, Params
from quadctl.schemas.services import (
    GetParamsRequest,
    GetParamsResponse,
    SetParamsRequest,
    SetParamsResponse,
)
from quadctl.schemas.typed import converted
from quadctl.services.airspace import airworthiness
from quadctl.services.runtime import run_files
from quadctl.services.runtime.errors import Invalid, QuadctlError
from quadctl.services.runtime.nesting import TOO_DEEP, is_too_deep
from quadctl.services.runtime.params.load import check, check_range
from quadctl.services.runtime.params.names import flatten, nearest, normal_name, put
from quadctl.services.runtime.realm import Realm, write_atomically

_RANGE = "safety.acceptance_range"


def save_all_values(realm: Realm, fleet: Mapping[str, Params]) -> None:
    """Write every vehicle's tables, once before any node starts; raises OSError."""
    realm.params.mkdir(parents=True, exist_ok=True)
    for vehicle, params in fleet.items():
        for file in run_files.changed(realm, vehicle).glob("*"):
            file.unlink()
        write_atomically(run_files.launched(realm, vehicle), msgspec.json.encode(params))


def save_values(realm: Realm, vehicle: str, name: str, table: Any) -> None:
    """Write one table of a live run; raises QuadctlError if the disk is full or read-only."""
    if not run_files.launched(realm, vehicle).is_file():
        return
    folder = run_files.changed(realm, vehicle)
    try:
        folder.mkdir(exist_ok=True)
        write_atomically(folder / f"{name}.json", msgspec.json.encode(table))
    except OSError as error:
        raise QuadctlError(
            f"the parameters of {name} cannot be kept in {folder}: {error.strerror}",
            "make room on its disk",
        ) from error


def read_values(realm: Realm, vehicle: str) -> Params | None:
    """Return a vehicle's parameters; None if nothing runs, or the run has no such vehicle."""
    tables, source = run_files.tables(realm, vehicle), str(realm.params / vehicle)
    if not tables:
        return None
    try:
        return check(tables, source, in_wind=False)
    except Invalid:
        # Written by a newer `up`, which has parameters that are not declared here.
        from quadctl.services.runtime.params.catalogue import declared

        known: dict[str, Any] = {}
        for name, value in declared(dict(flatten(tables))).items():
            put(known, name, value, source)
        return check(known, source, in_wind=False)


def adopt(params: Params, name: str, values: Any) -> None:
    """Take values that another node has accepted for its table, in place; raises Invalid if they are none.

    That node has judged them by all values at that time. Judged again by those of a later one, they could be
    dropped, and the two nodes would go on with different ones.
    """
    table: Struct = getattr(params, name)
    tables = {name: msgspec.to_builtins(table)}
    try:
        if is_too_deep(values):
            raise Invalid(f"the values are {TOO_DEEP}")
        for leaf, value in flatten(converted(values, dict[str, Any])):
            put(tables, leaf, value, name)
        _copy(converted(tables[name], type(table)), table)
    except msgspec.ValidationError as error:
        why = f"a change of {name} cannot be followed: {error}"
        raise Invalid(why, "use one version of quadctl for all nodes") from error


class LiveParams:
    """One node's table of parameters, changed in place, so that every reference sees the change.

    `save` is called with the new table before it takes effect, `changed` after. `in_force` returns
    the values in force, by leaf name, of parameters that wait for the vehicle's next standstill.
    """

    def __init__(
        self,
        name: str,
        params: Params,
        save: Callable[[Any], None],
        changed: Callable[[], None],
        in_force: Callable[[], dict[str, Any]] = dict,
    ) -> None:
        self._name, self._params, self._save, self._changed = name, params, save, changed
        self._in_force = in_force

    def get(self, request: GetParamsRequest) -> GetParamsResponse:
        """Return values by leaf name or by table; all of the node's if no name is given."""
        values = dict(flatten(self._table(), self._name))
        in_force = self._in_force()
        if not request.names:
            return GetParamsResponse(values, in_force)
        found: dict[str, Any] = {}
        for name in map(normal_name, request.names):
            part = [leaf for leaf in values if leaf == name or leaf.startswith(f"{name}.")]
            if not part:
                raise Invalid(f"{self._name} has no parameter {name}", nearest(name, values))
            found |= {leaf: values[leaf] for leaf in part}
        in_force = {name: value for name, value in in_force.items() if name in found}
        return GetParamsResponse(found, in_force)

    def set(self, request: SetParamsRequest) -> SetParamsResponse:
        """Check all values, save them, then apply all of them; the reason tells what limits them.

        Nobody can refuse a wind: a vehicle is judged in it only if body or gains are set, or the range
        in which it has to hold its place.
        """
        before = self._limited()
        try:
            fresh = self._checked(request.values)
        except Invalid as error:
            return SetParamsResponse(False, "; ".join(filter(None, (error.message, error.hint))))
        self._save(msgspec.to_builtins(fresh))
        _copy(fresh, getattr(self._params, self._name))
        self._changed()
        requested = {normal_name(name) for name, _ in flatten(request.values)}
        waits = sorted(requested & self._in_force().keys())
        told = [line for line in self._limited() if line not in before]
        reason = "; ".join(["from the next standstill"] * bool(waits) + told)
        return SetParamsResponse(True, reason, waits)

    def _limited(self) -> list[str]:
        dynamics = self._params.dynamics
        if self._name != "dynamics":
            return []
        return airworthiness.limited(dynamics.vehicle, dynamics.control, dynamics.wind)

    def _checked(self, values: dict[str, Any]) -> Struct:
        tables = msgspec.to_builtins(self._params)
        in_wind = ranges = False
        if is_too_deep(values):
            raise Invalid(f"the values are {TOO_DEEP}")
        for name, value in flatten(values):
            if normal_name(name).partition(".")[0] != self._name:
                raise Invalid(f"{name} is not a parameter of {self._name}")
            put(tables, name, value, "param set")
            in_wind = in_wind or normal_name(name).startswith(FROM_STANDSTILL)
            ranges = ranges or normal_name(name) == _RANGE
            if normal_name(name) in FIXED_AT_LAUNCH:
                ways = (LIVE_SWITCHES.get(normal_name(name)), f"`quadctl up --set {name}=...`")
                hint = f"use {', or '.join(filter(None, ways))}"
                raise Invalid(f"{name} is fixed at launch", hint)
        checked = check(tables, "param set", in_wind=in_wind)
        if ranges:
            check_range(checked, checked.dynamics.wind, "param set")
        table: Struct = getattr(checked, self._name)
        return table

    def _table(self) -> dict[str, Any]:
        table: dict[str, Any] = msgspec.to_builtins(getattr(self._params, self._name, {}))
        return table


def _copy(source: Struct, target: Struct) -> None:
    for name in source.__struct_fields__:
        value = getattr(source, name)
        if isinstance(value, Struct):
            _copy(value, getattr(target, name))
        else:
            setattr(target, name, value)
