"""Our parameters as those of ROS: values, descriptions, and the listing by prefix and depth.

Numbers, texts, bools and lists of them have their types of ROS. Anything else, such as zones, is a
string in TOML's notation.
"""

from collections.abc import Iterable
from typing import Any

from msgspec import inspect, structs

from quadctl.schemas.typeinfo import bounds_text
from quadctl.services.ros2.messages import (
    Descriptors,
    FloatingPointRange,
    IntegerRange,
    ListRequest,
    ListResponse,
    ListResult,
    Names,
    ParameterDescriptor,
    Parameters,
    ParameterTypes,
    ParameterValue,
    Result,
    Results,
    RosParameter,
    SetParametersResult,
    Values,
)
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.params.catalogue import Entry, fixed_at_launch, leaves, value
from quadctl.services.runtime.params.names import value_of
from quadctl.services.runtime.params.remote import RemoteParams

_FIELDS = {
    1: "bool_value",
    2: "integer_value",
    3: "double_value",
    4: "string_value",
    5: "byte_array_value",
    6: "bool_array_value",
    7: "integer_array_value",
    8: "double_array_value",
    9: "string_array_value",
}
"""Fields of ParameterValue by its `type`, which is 0 for no value."""
_SCALARS = {bool: 1, int: 2, float: 3, str: 4}
_ARRAYS = {bool: 6, int: 7, float: 8, str: 9}
_MOST = 200
"""Parameters that one request may set: more than we have."""
_MOST_INTEGER = 2**63 - 1


class ParameterStore:
    """Parameters of the vehicle's nodes behind the six services that a node of ROS has."""

    def __init__(self, ours: RemoteParams) -> None:
        self._ours = ours

    def list(self, request: ListRequest) -> ListResponse:
        """List the parameters of the nodes that answer."""
        return ListResponse(listed(self._ours.read(), request))

    def get(self, request: Names) -> Values:
        """Return the values; that of an unknown name is not set, as in ROS."""
        values = self._ours.read()
        unset = ParameterValue()
        return Values(
            tuple(to_ros(values[name]) if name in values else unset for name in request.names)
        )

    def types(self, request: Names) -> ParameterTypes:
        """Return the types of the values."""
        return ParameterTypes(bytes(each.type for each in self.get(request).values))

    def describe(self, request: Names) -> Descriptors:
        """Return the descriptions."""
        values, entries = self._ours.read(), leaves()
        return Descriptors(
            tuple(
                described(name, values[name], entries.get(name))
                if name in values
                else ParameterDescriptor(name)
                for name in request.names
            )
        )

    def set(self, request: Parameters) -> Results:
        """Set each value by itself, as ROS does; refuse more of them than we have."""
        if len(request.parameters) > _MOST:
            refused = SetParametersResult(successful=False, reason=f"at most {_MOST} at a time")
            return Results((refused,) * len(request.parameters))
        return Results(tuple(self._set((each,)) for each in request.parameters))

    def set_atomically(self, request: Parameters) -> Result:
        """Set all values or none."""
        return Result(self._set(request.parameters))

    def _set(self, given: tuple[RosParameter, ...]) -> SetParametersResult:
        if not given:
            return SetParametersResult(successful=True)
        present = self._ours.read()
        changes = {each.name: to_ours(each.value, present.get(each.name)) for each in given}
        try:
            return SetParametersResult(successful=True, reason=self._ours.set(changes))
        except QuadctlError as problem:
            return SetParametersResult(successful=False, reason=problem.message)


def to_ros(plain: Any) -> ParameterValue:
    """Return a value of ours as one of ROS."""
    kind = _kind(plain)
    if not kind:
        return ParameterValue(type=_SCALARS[str], string_value=value(plain))
    content = tuple(plain) if isinstance(plain, list) else plain
    return structs.replace(ParameterValue(type=kind), **{_FIELDS[kind]: content})


def to_ours(given: ParameterValue, present: Any) -> Any:
    """Return a value of ROS as one of ours, None for no value; `present` shows what is expected."""
    content = getattr(given, _FIELDS[given.type]) if given.type in _FIELDS else None
    if isinstance(content, str) and not isinstance(present, str):
        return value_of(content)
    return list(content) if isinstance(content, tuple | bytes) else content


def _kind(plain: Any) -> int:
    """Return the type of ROS that a value has; 0 if ROS has none."""
    if isinstance(plain, int) and abs(plain) > _MOST_INTEGER:
        return 0
    if isinstance(plain, list):
        kinds = {type(each) for each in plain}
        return _ARRAYS.get(kinds.pop(), 0) if len(kinds) == 1 else 0
    return _SCALARS.get(type(plain), 0)


def described(name: str, plain: Any, entry: Entry | None) -> ParameterDescriptor:
    """Return the description of a parameter with its present value; a user's own has no `entry`."""
    kind = to_ros(plain).type
    if entry is None:
        return ParameterDescriptor(name, kind)
    unit = f" ({entry.unit})" if entry.unit else ""
    floats, integers = _ranges(entry.type)
    return ParameterDescriptor(
        name,
        kind,
        f"{entry.about}{unit}",
        # A range of ROS is closed at both ends; others are only text.
        "" if floats or integers else bounds_text(entry.type),
        read_only=fixed_at_launch(name),
        floating_point_range=floats,
        integer_range=integers,
    )


def _ranges(
    type_: inspect.Type,
) -> tuple[tuple[FloatingPointRange, ...], tuple[IntegerRange, ...]]:
    if isinstance(type_, inspect.Metadata):
        return _ranges(type_.type)
    if isinstance(type_, inspect.FloatType) and type_.ge is not None and type_.le is not None:
        return (FloatingPointRange(type_.ge, type_.le),), ()
    if isinstance(type_, inspect.IntType) and type_.ge is not None and type_.le is not None:
        return (), (IntegerRange(type_.ge, type_.le),)
    return (), ()


def listed(names: Iterable[str], request: ListRequest) -> ListResult:
    """Return the names below the prefixes (all without any), as deep as requested (0: any)."""
    found = sorted(
        name
        for name in names
        if not request.prefixes
        or any(_is_below(name, prefix, request.depth) for prefix in request.prefixes)
    )
    if not request.prefixes and request.depth:
        found = [name for name in found if name.count(".") < request.depth]
    prefixes = {name.rpartition(".")[0] for name in found}
    return ListResult(tuple(found), tuple(sorted(prefixes - {""})))


def _is_below(name: str, prefix: str, depth: int) -> bool:
    if name == prefix:
        return True
    rest = name.removeprefix(f"{prefix}.")
    return rest != name and (not depth or rest.count(".") < depth)
