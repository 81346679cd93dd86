"""Places, missions and fences of MAVLink."""

from math import dist, inf, nan

import pytest
from hypothesis import given, strategies as st
from msgspec.structs import replace
from pymavlink.dialects.v20 import common as mavlink

from quadctl.schemas.earth import Origin
from quadctl.schemas.zones import CircleParams, ZoneKind, ZoneParams
from quadctl.services.bridges.mavlink.plan import (
    NOWHERE,
    Flyer,
    MissionStep,
    PlanItem,
    items_of,
    point_of,
    steps_of,
    zones_of,
)
from quadctl.services.runtime.errors import Invalid

HOME = Origin(47.397742, 8.545594, 488.0)
FLYER = Flyer((3.0, 4.0), 5.0)
RELATIVE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
WAYPOINT, LAND = mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_LAND
CORNER_IN, CORNER_OUT, CIRCLE_IN, CIRCLE_OUT = (
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
)

latitudes = st.floats(-60, 60)
longitudes = st.floats(-180, 180)
near = st.floats(-100, 100)
origins = st.builds(Origin, latitudes, longitudes, st.floats(-100, 4000))


def item(command: int, *params: float, at: tuple[float, float] = (0, 0), z: float = 0) -> PlanItem:
    first, second = (*params, 0.0, 0.0)[:2]
    return PlanItem(RELATIVE, command, (first, second, 0.0, 0.0), *HOME.to_earth(*at), z)


@pytest.mark.parametrize(
    ("frame", "z", "height"),
    [(0, 490.0, 2.0), (5, 490.0, 2.0), (3, 2.0, 2.0), (6, 2.0, 2.0), (6, nan, None)],
)
def test_heights_are_of_the_frame(frame: int, z: float, height: float | None):
    assert point_of(PlanItem(frame, WAYPOINT, (0.0,) * 4, z=z), HOME).z == height


def test_an_item_without_a_place_keeps_the_present_one():
    step = point_of(PlanItem(RELATIVE, WAYPOINT, (0.0,) * 4), HOME)
    assert step == MissionStep()
    assert not step.flies


@pytest.mark.parametrize(
    ("given", "step"),
    [
        (item(WAYPOINT, 2.5, z=1), MissionStep(0.0, 0.0, 1.0, 2.5)),
        (item(WAYPOINT, nan, z=1), MissionStep(0.0, 0.0, 1.0)),
        (item(mavlink.MAV_CMD_NAV_LOITER_TIME, 9, z=1), MissionStep(0.0, 0.0, 1.0, 9.0)),
        (item(mavlink.MAV_CMD_NAV_LOITER_UNLIM, z=1), MissionStep(0.0, 0.0, 1.0)),
        (item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH), MissionStep(3.0, 4.0, None, lands=True)),
        (item(mavlink.MAV_CMD_NAV_DELAY, 3), MissionStep(wait=3.0)),
        (item(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 5), MissionStep()),
        (item(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, -1), MissionStep()),
        (PlanItem(RELATIVE, LAND, (0.0,) * 4, 0, 0, 0.0), MissionStep(lands=True)),
        (PlanItem(2, mavlink.MAV_CMD_NAV_TAKEOFF, (0.0,) * 4, 0, 0, 2.0), None),
        (PlanItem(RELATIVE, mavlink.MAV_CMD_NAV_TAKEOFF, (0.0,) * 4, 0, 0, 2.0), MissionStep(z=2)),
        (item(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 4.9), None),
        (item(mavlink.MAV_CMD_NAV_DELAY, -1, 12), None),
        (item(mavlink.MAV_CMD_DO_JUMP, 0), None),
        (item(WAYPOINT, -1, z=1), None),
        (item(WAYPOINT, inf, z=1), None),
        (replace(item(WAYPOINT, z=1), goes_on=False), None),
        (PlanItem(RELATIVE, LAND, (0.0,) * 4), MissionStep(lands=True)),
        (item(mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0), None),
    ],
)
def test_items_are_flown_or_refused(given: PlanItem, step: MissionStep | None):
    if step is None:
        with pytest.raises(Invalid, match="item 0: "):
            steps_of([given], HOME, FLYER)
        return
    (found,) = steps_of([given], HOME, FLYER)
    assert (found.wait, found.lands) == (step.wait, step.lands)
    for got, wanted in ((found.x, step.x), (found.y, step.y), (found.z, step.z)):
        assert got == (None if wanted is None else pytest.approx(wanted, abs=0.01))


def test_loitering_for_ever_is_only_the_end_of_a_mission():
    loiter = item(mavlink.MAV_CMD_NAV_LOITER_UNLIM, z=1)
    with pytest.raises(Invalid, match="item 0: command 17"):
        steps_of([loiter, item(WAYPOINT, z=1)], HOME, FLYER)


corners = st.lists(st.tuples(near, near), min_size=3, max_size=8)
kinds: st.SearchStrategy[ZoneKind] = st.sampled_from(("inclusion", "exclusion"))


@st.composite
def zones(draw: st.DrawFn) -> ZoneParams:
    kind = draw(kinds)
    if draw(st.booleans()):
        circle = CircleParams(draw(near), draw(near), draw(st.integers(1, 1000)) / 8)
        return ZoneParams("z", kind, circle=circle)
    x, y, size = draw(near), draw(near), draw(st.integers(1, 100))
    shape = draw(st.sampled_from([((0, 0), (1, 0), (1, 1), (0, 1)), ((0, 0), (1, 0), (0, 2))]))
    return ZoneParams("z", kind, tuple((x + size * a, y + size * b) for a, b in shape))


@given(st.lists(zones(), max_size=6))
def test_zones_come_back_from_a_fence_as_they_were(given_zones: list[ZoneParams]):
    found = zones_of(items_of(given_zones, HOME), HOME)
    assert len(found) == len(given_zones)
    for back, zone in zip(found, given_zones, strict=True):
        assert (back.kind, back.circle.radius) == (zone.kind, zone.circle.radius)
        assert len(back.polygon) == len(zone.polygon)
        for one, other in zip(back.polygon, zone.polygon, strict=True):
            assert dist(one, other) < 0.011


fence_items = st.builds(
    PlanItem,
    st.integers(0, 12),
    st.sampled_from([CORNER_IN, CORNER_OUT, CIRCLE_OUT, 5003, 5000, 16]),
    st.tuples(*[st.sampled_from([0.0, 1.0, 3.0, 4.0, 2.5, nan, inf, -1.0])] * 4),
    st.integers(-1_800_000_000, NOWHERE),
    st.integers(-1_800_000_000, NOWHERE),
    st.floats(),
)


@given(st.lists(fence_items, max_size=12))
def test_any_fence_is_zones_or_refused(items: list[PlanItem]):
    try:
        found = zones_of(items, HOME)
    except Invalid:
        return
    assert sum(max(len(zone.polygon), 1) for zone in found) == len(items)


@given(st.lists(st.builds(PlanItem, st.integers(0, 12), st.integers(0, 300), st.tuples(*[st.floats(width=32)] * 4), st.integers(-(2**31), NOWHERE), st.integers(-(2**31), NOWHERE), st.floats(width=32)), max_size=5))  # fmt: skip
def test_any_mission_is_steps_or_refused(items: list[PlanItem]):
    try:
        found = steps_of(items, HOME, FLYER)
    except Invalid:
        return
    assert len(found) == len(items)


@pytest.mark.parametrize(
    ("items", "problem"),
    [
        ([item(CORNER_IN, 4)] * 3, "fence 1: a polygon has not the 4 corners"),
        (
            [item(CORNER_IN, 3), item(CORNER_OUT, 3), item(CORNER_IN, 3)],
            "fence 1: its corners are of several",
        ),
        ([item(CIRCLE_OUT, 0)], "fence 1: a circle of radius 0 m"),
        ([item(CIRCLE_OUT, 1, at=(n, 0)) for n in range(51)], "51 zones: at most 50"),
        ([item(CIRCLE_OUT, -1, at=(1, 1))], "fence 1: a circle of radius -1 m"),
        ([item(CIRCLE_IN, nan, at=(1, 1))], "fence 1: a circle of radius nan m"),
        ([item(CIRCLE_IN, inf, at=(1, 1))], "fence 1: a circle of radius inf m"),
        ([item(CORNER_IN, 3, at=(n + 1, 0)) for n in range(3)], "fence 1"),
        ([item(CIRCLE_IN, 1, at=(n + 1, 0)) for n in range(2)], "fence 2: two inclusion zones"),
        ([replace(item(CIRCLE_OUT, 1), x=NOWHERE)], "fence 1: a point has no place"),
        ([replace(item(CIRCLE_OUT, 1), x=910_000_000)], "no place on the earth"),
        ([replace(item(CIRCLE_OUT, 1, at=(1, 0)), frame=1)], "frame 1 is not known"),
    ],
)
def test_a_fence_is_refused_with_its_reason(items: list[PlanItem], problem: str):
    with pytest.raises(Invalid, match=problem):
        zones_of(items, HOME)
