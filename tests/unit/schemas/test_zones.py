"""Zones as parameters: which polygons have an inside, and what is refused."""

import pytest
from hypothesis import given, strategies as st
from msgspec import ValidationError, convert
from shapely.geometry import Polygon

from quadctl.schemas.params import SafetyParams
from quadctl.schemas.zones import ZoneParams, turn, why_not_simple

SQUARE = [[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]]
GRID = st.tuples(st.integers(-3, 3), st.integers(-3, 3)).map(lambda p: (float(p[0]), float(p[1])))


def zones(*tables: dict[str, object]) -> SafetyParams:
    return convert({"zones": list(tables)}, SafetyParams)


def test_a_zone_is_read_with_its_defaults():
    (zone,) = zones({"name": "tower", "polygon": SQUARE}).zones
    assert zone == ZoneParams("tower", polygon=((1, 1), (2, 1), (2, 2), (1, 2)))
    assert (zone.kind, zone.floor, zone.ceiling) == ("exclusion", -10_000, 10_000)


@pytest.mark.parametrize(
    ("zone", "why"),
    [
        ({"polygon": SQUARE, "circle": {"x": 0, "y": 0, "radius": 1}}, "either a polygon or a circle"),
        ({}, "either a polygon or a circle"),
        ({"polygon": SQUARE[:2]}, "2 corners"),
        ({"polygon": [[n, n * n] for n in range(65)]}, "65 corners"),
        ({"polygon": [*SQUARE, [1.0, 2.0]]}, "corners 4 and 5 are the same point"),
        ({"polygon": [SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]]}, "cross or touch"),
        ({"polygon": [[0, 0], [2, 0], [1, 0], [1, 1]]}, "the edges at corner 2 lie on each other"),
        ({"polygon": SQUARE, "floor": 1.0, "ceiling": 1.0}, "floor 1 is not below ceiling 1"),
        ({"circle": {"x": 0, "y": 0, "radius": -1}}, "radius"),
        ({"polygon": [[0, 0], [1, float("nan")], [1, 1]]}, "polygon"),
        ({"polygon": SQUARE, "hight": 3}, "unknown field `hight`"),
        ({"polygon": SQUARE, "kind": "stay-out"}, "stay-out"),
    ],
)  # fmt: skip
def test_an_unclear_zone_is_refused(zone: dict[str, object], why: str):
    with pytest.raises(ValidationError, match=why):
        zones({"name": "a", **zone})


@pytest.mark.parametrize("name", ["", "cage", "a\nb", "x" * 65, "\u202ea"])
def test_a_name_that_cannot_be_shown_or_means_the_box_is_refused(name: str):
    with pytest.raises(ValidationError):
        zones({"name": name, "polygon": SQUARE})


def test_two_zones_of_one_name_and_too_many_zones_are_refused():
    with pytest.raises(ValidationError, match="two zones have the name a"):
        zones(*[{"name": "a", "polygon": SQUARE}] * 2)
    with pytest.raises(ValidationError, match="51 zones: at most 50"):
        zones(*({"name": f"z{n}", "polygon": SQUARE} for n in range(51)))


@given(st.lists(GRID, min_size=3, max_size=7, unique=True))
def test_a_polygon_is_simple_exactly_where_shapely_finds_it_valid(
    corners: list[tuple[float, float]],
):
    assert (not why_not_simple(corners)) is Polygon(corners).is_valid


def test_a_turn_is_exact_where_floating_point_is_not():
    # Points a rounding beside the line from (0, 0) to (3, 3).
    assert turn(0.1, 0.1, 0.3, 0.3, 0.2, 0.2) == 0
    assert turn(0.0, 0.0, 3.0, 3.0, 1.0, 1.0000000000000002) == 1
    assert turn(12.0, 12.0, 24.0, 24.0, 0.5, 0.5000000000000001) == 1
    assert turn(12.0, 12.0, 24.0, 24.0, 0.5000000000000001, 0.5) == -1
