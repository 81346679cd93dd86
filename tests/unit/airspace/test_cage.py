"""The cage: closed intervals, exact to the last bit, with a reason that names the axis."""

from math import inf, nan, nextafter
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st
from msgspec.structs import astuple, replace

from quadctl.schemas.messages import CageSize, Position
from quadctl.services.airspace.cage import bounds, why_outside
from quadctl.services.airspace.geometry import Point

CAGE = CageSize(5.0, 4.0, 2.0)
MIDDLE = Position(0.0, 0.0, 1.0)
FACES = [("x", -5.0), ("x", 5.0), ("y", -4.0), ("y", 4.0), ("z", 0.0), ("z", 2.0)]
SIZES = st.floats(0.2, 10_000)
NUMBERS = st.floats(-10_000, 10_000)


def moved(axis: str, value: float, point: Position = MIDDLE) -> Point:
    change: dict[str, Any] = {axis: value}
    return astuple(replace(point, **change))


def outwards(value: float) -> float:
    return -inf if value <= 0 else inf


def test_the_bounds_are_symmetric_in_x_and_y_and_start_at_the_floor():
    assert bounds(CAGE) == {"x": (-5.0, 5.0), "y": (-4.0, 4.0), "z": (0.0, 2.0)}


@pytest.mark.parametrize(("axis", "face"), FACES)
def test_a_face_is_inside_the_cage_to_the_last_bit(axis: str, face: float):
    out = outwards(face)
    assert why_outside(moved(axis, face), CAGE) == ""
    assert why_outside(moved(axis, nextafter(face, -out)), CAGE) == ""
    assert why_outside(moved(axis, nextafter(face, out)), CAGE) != ""


@pytest.mark.parametrize(("axis", "face"), FACES)
@settings(max_examples=50)
@given(size=SIZES)
def test_a_face_is_inside_for_every_size(axis: str, face: float, size: float):
    cage = CageSize(size, size, size)
    wall = 0.0 if face == 0 else size if face > 0 else -size
    inside = replace(MIDDLE, z=0.1)
    point = moved(axis, wall, inside)
    beyond = moved(axis, nextafter(wall, outwards(face)), inside)
    assert why_outside(point, cage) == ""
    assert why_outside(beyond, cage).startswith(f"outside the cage: {axis} = ")


@given(*[SIZES] * 3, *[NUMBERS] * 3)
def test_inside_means_inside_on_every_axis(
    a: float, b: float, c: float, x: float, y: float, z: float
):
    inside = abs(x) <= a and abs(y) <= b and 0 <= z <= c
    assert (why_outside((x, y, z), CageSize(a, b, c)) == "") is inside


def test_negative_zero_is_on_the_floor():
    assert why_outside(moved("z", -0.0), CAGE) == ""


@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_nan_and_infinity_are_outside(axis: str, value: float):
    assert f"{axis} = {value}" in why_outside(moved(axis, value), CAGE)


def test_the_reason_names_the_axis_the_value_and_the_bounds():
    assert why_outside((0.0, -4.25, 1.0), CAGE) == ("outside the cage: y = -4.25 is beyond [-4, 4]")
    # The first axis outside; a tiny excess is still distinct from the bound.
    assert why_outside((5.0000000001, 9.0, 9.0), CAGE) == (
        "outside the cage: x = 5.0000000001 is beyond [-5, 5]"
    )
    assert why_outside(moved("x", 97.0000001087489), CAGE) == (
        "outside the cage: x = 97 is beyond [-5, 5]"
    )
    assert why_outside(moved("z", -1.0), CAGE) == "outside the cage: z = -1 is beyond [0, 2]"
