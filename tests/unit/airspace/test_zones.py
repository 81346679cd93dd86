"""Geometry of zones beside shapely's, at boundaries, and for many zones at once."""

import math
from fractions import Fraction

import pytest
from hypothesis import assume, given, settings, strategies as st

from quadctl.schemas.zones import CircleParams, ZoneParams, why_not_simple
from quadctl.services.airspace.routes import cuts
from quadctl.services.airspace.zones import (
    Region,
    contains,
    crosses,
    depth,
    spans,
    zone_of,
)
from tests.support.proofs import Proofs
from tests.support.zone_geometry import around, compare, decisions

SQUARE = ((1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (1.0, 3.0))
BLOCK = zone_of(ZoneParams("block", polygon=SQUARE, floor=1.0, ceiling=2.0))
DISC = zone_of(ZoneParams("disc", circle=CircleParams(0.0, 0.0, 1.0), ceiling=2.0))

COORDINATE = st.one_of(
    st.integers(-4, 4).map(float), st.floats(-4, 4, allow_nan=False).map(lambda v: round(v, 6))
)
CORNER = st.tuples(COORDINATE, COORDINATE)


@st.composite
def polygons(draw: st.DrawFn) -> list[tuple[float, float]]:
    """Draw a simple polygon, often a concave one."""
    corners = around(draw(st.lists(CORNER, min_size=3, max_size=8, unique=True)), *draw(CORNER))
    assume(not why_not_simple(corners))
    return corners


@pytest.mark.thorough
@settings(max_examples=400)
@given(polygons(), CORNER, CORNER)
def test_ways_places_and_boxes_agree_with_shapely(
    corners: list[tuple[float, float]], p: tuple[float, float], q: tuple[float, float]
):
    assert [name for name, agrees in decisions(corners, p, q) if not agrees] == []


@pytest.mark.prove
@pytest.mark.timeout(3600)
def test_a_million_decisions_about_zones_agree_with_shapely(proofs: Proofs):
    made, odd = compare(1_000_000, seed=1)
    proofs.add(
        "decisions about zones that shapely does not share, beyond 1e-9 m of a boundary",
        f"{len(odd)} of {made}", "0",
    )  # fmt: skip
    assert odd == []


@pytest.mark.parametrize(
    ("p", "q", "crossed"),
    [
        ((0.0, 2.0, 1.5), (4.0, 2.0, 1.5), True),
        ((0.0, 1.0, 1.5), (4.0, 1.0, 1.5), False),  # along a side
        ((0.0, 2.0, 1.5), (2.0, 0.0, 1.5), False),  # by a corner
        ((0.0, 2.0, 1.5), (1.0, 2.0, 1.5), False),  # up to a side
        ((0.0, 2.0, 2.0), (4.0, 2.0, 2.0), False),  # on the top
        ((0.0, 2.0, 1.0), (4.0, 2.0, 1.0), False),  # under the bottom
        ((0.0, 2.0, 3.0), (4.0, 2.0, 1.0), True),
        ((0.0, 2.0, 3.0), (4.0, 2.0, 2.0), False),
        ((2.0, 2.0, 0.0), (2.0, 2.0, 3.0), True),  # straight up through it
        ((1.0, 2.0, 0.0), (1.0, 2.0, 3.0), False),  # straight up along a side
        ((2.0, 2.0, 1.5), (2.0, 2.0, 1.5), True),
        ((0.0, 2.0, 1.5), (4.0, 2.0, math.nextafter(1.5, 2)), True),
        ((0.0, math.nextafter(1.0, 2), 1.5), (4.0, 1.0, 1.5), True),  # a rounding inside
        ((0.0, math.nextafter(1.0, 0), 1.5), (4.0, 1.0, 1.5), False),
    ],
)  # fmt: skip
def test_a_boundary_belongs_to_the_allowed_side(p, q, crossed: bool):
    assert crosses(BLOCK, p, q) is crosses(BLOCK, q, p) is crossed
    assert cuts(BLOCK, p, q) is crossed or abs(p[1] - 1.0) < 1e-9


@pytest.mark.parametrize(
    ("p", "q", "crossed"),
    [
        ((-2.0, 1.0, 1.0), (2.0, 1.0, 1.0), False),  # a tangent
        ((-2.0, math.nextafter(1.0, 0), 1.0), (2.0, math.nextafter(1.0, 0), 1.0), True),
        ((-2.0, 0.0, 1.0), (-1.0, 0.0, 1.0), False),
        ((-2.0, 0.0, 2.0), (2.0, 0.0, 2.0), False),
        ((-2.0, 0.0, 3.0), (2.0, 0.0, 1.0), True),
        ((-1.0, 0.0, 3.0), (1.0, 0.0, 1.0), True),
        ((0.0, 0.0, 1.0), (0.0, 0.0, 9.0), True),
    ],
)  # fmt: skip
def test_a_way_past_a_cylinder_is_decided_exactly(p, q, crossed: bool):
    assert crosses(DISC, p, q) is crosses(DISC, q, p) is crossed


def test_a_way_in_a_cylinder_is_measured_from_the_inside():
    ((start, end),) = spans(DISC, (-2.0, 0.5, 1.0), (2.0, 0.5, 1.0))
    half = Fraction(3, 4)  # of the squared radius
    assert (4 * start - 2) ** 2 < half
    assert (4 * end - 2) ** 2 < half
    assert float(end - start) == pytest.approx(math.sqrt(3) / 4)


def test_a_thin_zone_is_as_deep_as_its_middle_for_a_way_through_it():
    wall = zone_of(ZoneParams("wall", polygon=((1.0, -5.0), (1.2, -5.0), (1.2, 5.0), (1.0, 5.0))))
    assert depth(wall, (0.0, 0.0, 1.0), (3.0, 0.0, 1.0)) == pytest.approx(0.1)
    assert depth(wall, (0.0, 0.0, 1.0), (1.05, 0.0, 1.0)) == pytest.approx(0.05)
    assert depth(wall, (0.0, 0.0, 1.0), (1.0, 0.0, 1.0)) == 0.0


TOWER = ZoneParams("tower", polygon=SQUARE)
WEST = ZoneParams("west", "inclusion", polygon=((-4.0, -4.0), (0.0, -4.0), (0.0, 4.0), (-4.0, 4.0)))
EAST = ZoneParams("east", "inclusion", polygon=((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)))


def test_the_reason_names_the_zone():
    found = Region([TOWER, WEST, EAST])
    assert found.why_inside((2, 2, 1)) == "inside the zone tower"
    assert found.why_inside((2, -2, 1)) == "outside the zones west, east"
    assert found.why_inside((1, 1, 1)) == found.why_inside((0, 0, 1)) == ""
    assert found.why_crosses((0.5, 2, 1), (3.5, 2, 1)) == "the way crosses the zone tower"
    # The two halves share a boundary, and a way over it never leaves them.
    assert found.why_crosses((-1, 0.5, 1), (3.5, 0.5, 1)) == ""
    assert found.why_crosses((-1, -1, 1), (3.5, 0.5, 1)) == "the way leaves the zones west, east"


def test_a_way_may_leave_a_zone_but_not_come_back():
    assert not Region([TOWER]).why_crosses((2, 2, 1), (5, 2, 1))
    hook = ZoneParams(
        "hook", polygon=((0, 0), (5, 0), (5, 1), (4, 1), (4, 0.5), (1, 0.5), (1, 1), (0, 1))
    )
    assert Region([hook]).why_crosses((0.5, 0.8, 1), (4.5, 0.8, 1)) != ""
    assert not Region([hook]).why_crosses((0.5, 0.8, 1), (2, 0.8, 1))
    assert Region([WEST]).why_crosses((1, 0, 1), (-1, 0, 1)) == ""
    assert Region([WEST]).why_crosses((-1, 0, 1), (1, 0, 1)) == "the way leaves the zone west"


def test_a_box_needs_one_inclusion_zone_that_has_all_of_it():
    found = Region([TOWER, WEST, EAST])
    assert found.why_overlaps(((-3.0, -3.0, 0.0), (0.0, 3.0, 2.0))) == ""
    assert (
        found.why_overlaps(((-1.0, 0.0, 0.0), (1.0, 1.0, 2.0)))
        == "the way leaves the zones west, east"
    )
    assert (
        found.why_overlaps(((0.5, 0.5, 0.0), (2.0, 2.0, 2.0))) == "the way crosses the zone tower"
    )
    assert found.why_overlaps(((1.0, 0.5, 0.0), (1.0, 3.5, 2.0))) == ""  # flat, along its side
    assert (
        found.why_overlaps(((2.0, 0.5, 0.0), (2.0, 3.5, 2.0))) == "the way crosses the zone tower"
    )


def test_the_nearest_wall_is_that_of_a_zone_or_of_what_holds_the_vehicle():
    assert Region([]).nearest((0, 0, 1)) is None
    assert Region([TOWER]).nearest((0, 2, 1)) == ("tower", 1.0)
    assert Region([TOWER]).nearest((2, 1.25, 1)) == ("tower", -0.25)
    assert Region([TOWER, EAST]).nearest((3.75, 2, 1)) == ("east", 0.25)


def test_an_inclusion_zone_of_a_floor_and_a_ceiling_holds_the_height():
    band = ZoneParams("band", "inclusion", circle=CircleParams(0, 0, 10), floor=1.0, ceiling=3.0)
    found = Region([band])
    assert found.why_inside((0, 0, 1)) == found.why_inside((0, 0, 3)) == ""
    assert found.why_inside((0, 0, 0.5)) == "outside the zone band"
    # A take-off from below comes in, and stays.
    assert found.why_crosses((0, 0, 0), (0, 0, 2)) == ""
    assert found.why_crosses((0, 0, 2), (0, 0, 4)) == "the way leaves the zone band"
    assert found.excess((0, 0, 2), (0, 0, 3.5)) == pytest.approx(0.5)


def test_contained_means_inside_or_on_the_boundary_as_asked():
    assert contains(BLOCK, (1.0, 2.0, 1.5), closed=True)
    assert not contains(BLOCK, (1.0, 2.0, 1.5), closed=False)
    assert contains(BLOCK, (1.5, 2.0, 2.0), closed=True)
    assert not contains(BLOCK, (1.5, 2.0, 2.0), closed=False)
