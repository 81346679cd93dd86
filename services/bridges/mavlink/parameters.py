"""Our parameters as those of MAVLink: names of 16 characters, and values in a float of 32 bits. Pure."""

import struct
from collections.abc import Mapping
from math import isfinite, isnan
from typing import Any, NamedTuple

from quadctl.services.runtime.errors import Invalid

MOST_LETTERS = 16
_INTEGER, _REAL = 6, 9
"""Types of parameters, MAV_PARAM_TYPE; a bool is an integer, like PX4's."""
_PX4 = {"safety.takeoff": "MIS_TAKEOFF_ALT"}
"""Names of PX4 that ground stations read."""


class MavlinkParameter(NamedTuple):
    """A parameter by its own name: its short name, its type, and its value as a float's bits."""

    own: str
    name: str
    type: int
    value: float


def short_name(own: str) -> str:
    """Return the name in MAVLink, e.g. S_VIRTUAL_CAGE_X of safety.virtual_cage.x.

    In too long a name, tables have their initials only: D_C_MAX_SPEED of dynamics.control.max_speed.
    """
    if own in _PX4:
        return _PX4[own]
    node, *tables, last = own.split(".")
    name = "_".join([node[0], *tables, last])
    if len(name) > MOST_LETTERS:
        initials = ("".join(word[0] for word in table.split("_")) for table in tables)
        name = "_".join([node[0], *initials, last])
    return name.upper()[:MOST_LETTERS]


def table(values: Mapping[str, Any]) -> list[MavlinkParameter]:
    """Return the numbers among values by dotted name, sorted by short name.

    MAVLink has no texts or tables. Of equal short names only the first one's is there. An integer with the bits of no number, from 2139095041 on, is
    left out: such bits change on their way.
    """
    found: dict[str, MavlinkParameter] = {}
    for own, value in values.items():
        if isinstance(value, int | float):
            each = MavlinkParameter(own, short_name(own), *_encoded(value))
            if not isnan(each.value):
                found.setdefault(each.name, each)
    return [found[name] for name in sorted(found)]


def _encoded(value: Any) -> tuple[int, float]:
    """Return type and value; the bits of an integer are those of the float, like PX4's."""
    if isinstance(value, float):
        return _REAL, value
    return _INTEGER, struct.unpack("<f", struct.pack("<i", value))[0]


def decoded(type_: int, value: float, present: Any) -> Any:
    """Return a received value in the type of the present one; raise Invalid for another type."""
    if not isinstance(present, float):
        if type_ != _INTEGER or isnan(value):
            raise Invalid("an integer was expected")
        number: int = struct.unpack("<i", _bits(value))[0]
        if isinstance(present, bool) and number not in {0, 1}:
            raise Invalid("0 or 1 was expected")
        return type(present)(number)
    if type_ != _REAL or not isfinite(value):
        raise Invalid("a finite real number was expected")
    # The shortest decimal of these 32 bits, e.g. 0.15 and not 0.15000000596.
    decimals = (float(f"{value:.{digits}g}") for digits in range(6, 10))
    return next(each for each in decimals if _bits(each) == _bits(value))


def _bits(value: float) -> bytes:
    return struct.pack("<f", value)
