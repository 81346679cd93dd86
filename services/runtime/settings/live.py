"""Reading and changing a running node's parameters."""

from collections.abc import Callable
from typing import Any

import msgspec
from msgspec import Struct

from schemas.params import FIXED_AT_LAUNCH, LIVE_SWITCHES, Params
from schemas.requests import (
    GetParamsRequest,
    GetParamsResponse,
    SetParamsRequest,
    SetParamsResponse,
)
from services.runtime.errors import Invalid
from services.runtime.settings.named import flatten, nearest, normal_name, put
from services.runtime.settings.params import check


class LiveParams:
    """One node's table of the parameters, changed in place, so that all who hold it see it.

    `save` is called with the new table before it takes effect, `changed` after.
    """

    def __init__(
        self,
        name: str,
        params: Params,
        save: Callable[[Any], None],
        changed: Callable[[], None],
    ) -> None:
        self._name, self._params, self._save, self._changed = name, params, save, changed

    def get(self, request: GetParamsRequest) -> GetParamsResponse:
        """Values by leaf name or by table; all of the node's when no name is given."""
        values = dict(flatten(self._table(), self._name))
        if not request.names:
            return GetParamsResponse(values)
        found: dict[str, Any] = {}
        for name in map(normal_name, request.names):
            part = {
                leaf: value
                for leaf, value in values.items()
                if leaf == name or leaf.startswith(f"{name}.")
            }
            if not part:
                hint = nearest(name, values)
                raise Invalid(f"{self._name} has no parameter {name}", hint)
            found |= part
        return GetParamsResponse(found)

    def set(self, request: SetParamsRequest) -> SetParamsResponse:
        """Check all of them, then save, then change all of them."""
        try:
            fresh = self._checked(request.values)
        except Invalid as error:
            return SetParamsResponse(False, "; ".join(filter(None, (error.message, error.hint))))
        self._save(msgspec.to_builtins(fresh))
        _copy(fresh, getattr(self._params, self._name))
        self._changed()
        return SetParamsResponse(True, "")

    def _checked(self, values: dict[str, Any]) -> Struct:
        tables = {self._name: self._table()}
        for name, value in flatten(values):
            if normal_name(name).partition(".")[0] != self._name:
                raise Invalid(f"{name} is not a parameter of {self._name}")
            put(tables, name, value, "param set")
            if normal_name(name) in FIXED_AT_LAUNCH:
                ways = (LIVE_SWITCHES.get(normal_name(name)), f"`quadctl up --set {name}=...`")
                hint = f"use {', or '.join(filter(None, ways))}"
                raise Invalid(f"{name} is fixed at launch", hint)
        checked: Struct = getattr(check(tables, "param set"), self._name)
        return checked

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
