"""Our parameters as those of ROS: values, descriptions, and the listing by prefix and depth.

Numbers, texts, bools and lists of them have their types of ROS. Anything else, such as zones, is a
string in TOML's notation.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from msgspec import inspect
from rosbags.typesys.stores.ros2_jazzy import (
    rcl_interfaces__msg__FloatingPointRange as FloatingPointRange,
    rcl_interfaces__msg__IntegerRange as IntegerRange,
    rcl_interfaces__msg__ListParametersResult as ListParametersResult,
    rcl_interfaces__msg__Parameter as RosParameter,
    rcl_interfaces__msg__ParameterDescriptor as ParameterDescriptor,
    rcl_interfaces__msg__ParameterValue as ParameterValue,
    rcl_interfaces__msg__SetParametersResult as SetParametersResult,
)

from quadctl.schemas.typeinfo import bounds_text
from quadctl.services.bridges.ros2 import messages
from quadctl.services.bridges.ros2.messages import RosService
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.params.catalogue import Entry, fixed_at_launch, leaves, value
from quadctl.services.runtime.params.names import value_of
from quadctl.services.runtime.params.remote import RemoteParams

_KINDS: dict[int, tuple[str, Any]] = {
    1: ("bool_value", False),
    2: ("integer_value", 0),
    3: ("double_value", 0.0),
    4: ("string_value", ""),
    5: ("byte_array_value", np.zeros(0, np.uint8)),
    6: ("bool_array_value", np.zeros(0, np.bool_)),
    7: ("integer_array_value", np.zeros(0, np.int64)),
    8: ("double_array_value", np.zeros(0, np.float64)),
    9: ("string_array_value", []),
}
"""Fields of ParameterValue by its `type`, which is 0 for no value, and what is in them without it."""
_SCALARS = {bool: 1, int: 2, float: 3, str: 4}
_ARRAYS = {bool: 6, int: 7, float: 8, str: 9}
_MOST = 200
"""Parameters that one request may set: more than we have."""
_MOST_INTEGER = 2**63 - 1


class ParameterStore:
    """Parameters of the vehicle's nodes behind the six services that a node of ROS has.

    Each method takes the request of one, and returns the only field of its response.
    """

    def __init__(self, ours: RemoteParams) -> None:
        self._ours = ours
        self.services: dict[str, tuple[RosService, Any]] = {
            "list_parameters": (messages.LIST_PARAMETERS, self.list_names),
            "get_parameters": (messages.GET_PARAMETERS, self.get),
            "get_parameter_types": (messages.GET_PARAMETER_TYPES, self.types),
            "describe_parameters": (messages.DESCRIBE_PARAMETERS, self.describe),
            "set_parameters": (messages.SET_PARAMETERS, self.set_each),
            "set_parameters_atomically": (messages.SET_PARAMETERS_ATOMICALLY, self.set_atomically),
        }

    def list_names(self, request: Any) -> ListParametersResult:
        """List the parameters of the nodes that answer."""
        return listed(self._ours.read(), request.prefixes, request.depth)

    def get(self, request: Any) -> list[ParameterValue]:
        """Return the values; that of an unknown name is not set, as in ROS."""
        values = self._ours.read()
        return [to_ros(values[name]) if name in values else _value() for name in request.names]

    def types(self, request: Any) -> Any:
        """Return the types of the values."""
        return np.array([each.type for each in self.get(request)], np.uint8)

    def describe(self, request: Any) -> list[ParameterDescriptor]:
        """Return the descriptions; that of an unknown name is empty, as in ROS."""
        values = self._ours.read()
        entries = {name: entry for name, entry in leaves().items() if name in values}
        return [described(name, values.get(name), entries.get(name)) for name in request.names]

    def set_each(self, request: Any) -> list[SetParametersResult]:
        """Set each value by itself, as ROS does; refuse more of them than we have."""
        given = request.parameters
        if len(given) > _MOST:
            return [SetParametersResult(False, f"at most {_MOST} at a time")] * len(given)
        return [self._set([each]) for each in given]

    def set_atomically(self, request: Any) -> SetParametersResult:
        """Set all values or none."""
        return self._set(request.parameters)

    def _set(self, given: Iterable[RosParameter]) -> SetParametersResult:
        present = self._ours.read()
        changes = {each.name: to_ours(each.value, present.get(each.name)) for each in given}
        try:
            return SetParametersResult(True, self._ours.set(changes) if changes else "")
        except QuadctlError as problem:
            return SetParametersResult(False, problem.message)


def _value(kind: int = 0, content: Any = None) -> ParameterValue:
    """Return a value of a kind; without one it is not set."""
    fields = dict(_KINDS.values())
    if kind:
        name, blank = _KINDS[kind]
        fields[name] = np.array(content, blank.dtype) if isinstance(blank, np.ndarray) else content
    return ParameterValue(kind, **fields)


def to_ros(plain: Any) -> ParameterValue:
    """Return a value of ours as one of ROS."""
    kind = _kind(plain)
    return _value(kind, plain) if kind else _value(_SCALARS[str], value(plain))


def to_ours(given: ParameterValue, present: Any) -> Any:
    """Return a value of ROS as one of ours, None for no value; `present` shows what is expected."""
    content = getattr(given, _KINDS[given.type][0]) if given.type in _KINDS else None
    if isinstance(content, str) and not isinstance(present, str):
        return value_of(content)
    return content.tolist() if isinstance(content, np.ndarray) else content


def _kind(plain: Any) -> int:
    """Return the type of ROS that a value has; 0 if ROS has none."""
    if isinstance(plain, int) and abs(plain) > _MOST_INTEGER:
        return 0
    if isinstance(plain, list):
        kinds = {type(each) for each in plain}
        return _ARRAYS.get(kinds.pop(), 0) if len(kinds) == 1 else 0
    return _SCALARS.get(type(plain), 0)


def described(name: str, plain: Any, entry: Entry | None) -> ParameterDescriptor:
    """Return the description of a parameter with its present value, None for an unknown one.

    A user's own parameter has no `entry`.
    """
    kind = 0 if plain is None else to_ros(plain).type
    if entry is None:
        return ParameterDescriptor(name, kind, "", "", False, False, [], [])
    unit = f" ({entry.unit})" if entry.unit else ""
    floats, integers = _ranges(entry.type)
    # A range of ROS is closed at both ends; others are only text.
    text = "" if floats or integers else bounds_text(entry.type)
    about, fixed = f"{entry.about}{unit}", fixed_at_launch(name)
    return ParameterDescriptor(name, kind, about, text, fixed, False, floats, integers)


def _ranges(type_: inspect.Type) -> tuple[list[FloatingPointRange], list[IntegerRange]]:
    if isinstance(type_, inspect.Metadata):
        return _ranges(type_.type)
    if isinstance(type_, inspect.FloatType) and type_.ge is not None and type_.le is not None:
        return [FloatingPointRange(type_.ge, type_.le, 0.0)], []
    if isinstance(type_, inspect.IntType) and type_.ge is not None and type_.le is not None:
        return [], [IntegerRange(type_.ge, type_.le, 0)]
    return [], []


def listed(names: Iterable[str], prefixes: Iterable[str], depth: int) -> ListParametersResult:
    """Return the names below the prefixes (all without any), as deep as requested (0: any)."""
    found = sorted(
        name
        for name in names
        if not prefixes or any(_is_below(name, prefix, depth) for prefix in prefixes)
    )
    if not prefixes and depth:
        found = [name for name in found if name.count(".") < depth]
    parents = {name.rpartition(".")[0] for name in found}
    return ListParametersResult(found, sorted(parents - {""}))


def _is_below(name: str, prefix: str, depth: int) -> bool:
    if name == prefix:
        return True
    rest = name.removeprefix(f"{prefix}.")
    return rest != name and (not depth or rest.count(".") < depth)
