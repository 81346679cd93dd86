"""Our parameters as those of MAVLink: names of 16 characters, and values in a float of 32 bits. Pure."""

import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

MOST_LETTERS = 16
_INTEGER, _REAL = 6, 9
"""Types of parameters, MAV_PARAM_TYPE; a bool is an integer, as in PX4."""
TAKEOFF_HEIGHT = "MIS_TAKEOFF_ALT"
"""PX4's name of the height of a takeoff without one, which MAVSDK asks for."""
_PX4 = {"safety.takeoff": TAKEOFF_HEIGHT}


class Parameter(NamedTuple):
    """A parameter by its own name: its short name, its type, and its value as a float's bits."""

    own: str
    name: str
    type: int
    value: float


def short_name(own: str) -> str:
    """Return the name in MAVLink, e.g. S_VIRTUAL_CAGE_X of safety.virtual_cage.x."""
    if own in _PX4:
        return _PX4[own]
    node, _, rest = own.partition(".")
    return f"{node[0]}_{rest.replace('.', '_')}".upper()[:MOST_LETTERS]


def table(values: Mapping[str, Any]) -> list[Parameter]:
    """Return the numbers among the parameters, sorted by name; MAVLink has no texts or tables."""
    found = []
    for own, value in _leaves("", values).items():
        if isinstance(value, int | float):
            type_, number = encoded(value)
            found.append(Parameter(own, short_name(own), type_, number))
    return sorted(found, key=lambda each: each.name)


def _leaves(prefix: str, values: Mapping[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            found |= _leaves(f"{prefix}{name}.", value)
        else:
            found[prefix + name] = value
    return found


def encoded(value: float) -> tuple[int, float]:
    """Return type and value; the bits of an integer are those of the float, as PX4 has them."""
    if isinstance(value, float):
        return _REAL, value
    return _INTEGER, struct.unpack("<f", struct.pack("<i", value))[0]


def decoded(type_: int, value: float, present: float) -> float:
    """Return a received value as one of the type of the present one; raise ValueError if it has another."""
    if isinstance(present, float):
        if type_ != _REAL:
            raise ValueError("a real number was expected")
        # The shortest decimal of these 32 bits, e.g. 0.15 and not 0.15000000596.
        return float(f"{value:.7g}")
    if type_ != _INTEGER:
        raise ValueError("an integer was expected")
    number: int = struct.unpack("<i", struct.pack("<f", value))[0]
    if isinstance(present, bool):
        if number not in {0, 1}:
            raise ValueError("0 or 1 was expected")
        return bool(number)
    return number
