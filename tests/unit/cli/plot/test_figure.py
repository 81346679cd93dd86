"""Data of a plot: paths by boot and vehicle, verdicts, phases."""

from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from quadctl.cli.plot import figure
from quadctl.cli.plot.figure import draw
from quadctl.cli.plot.track import MOST_POINTS, Curve, RecordedFlight, Spot, is_drawn
from quadctl.schemas.messages import Position, Waypoint
from quadctl.services.runtime.bus import codec
from tests.support.bags import pose, pressure, raw_message, refused, state


def gathered(*messages) -> RecordedFlight:
    flight = RecordedFlight()
    for key, message in messages:
        one = raw_message(key, message, 0)
        if is_drawn(key):
            flight.add(key, partial(codec.decode, payload=one.payload, encoding=one.encoding))
    return flight


def test_a_new_boot_continues_in_time_and_starts_a_leg():
    messages = [("uav/pose", pose(seq)) for seq in range(3)]
    messages += [("uav/pose", pose(seq, boot="b1")) for seq in range(2)]
    track = gathered(*messages).tracks["uav"]
    assert [len(leg) for leg in track.legs] == [3, 2]
    assert [point[0] for point in track.path] == [0.0, 0.01, 0.02, 0.02, 0.03]
    assert track.boots == [0.02]


def test_every_vehicle_has_its_own_track():
    flight = gathered(("uav0/pose", pose(0)), ("uav1/pose", pose(0)), ("uav2/info", state(0)))
    assert list(flight.flown()) == ["uav0", "uav1"]


def test_refused_goals_are_found_in_calls_and_states():
    goal = Position(1.0, 2.0, 3.0)
    track = gathered(
        ("uav/pose", pose(0)),
        ("uav/@call/goto", refused(9, 0, 1)),
        ("uav/safety/state", state(0.0, state="MOVING", goal=goal)),
        ("uav/input/position_request", Waypoint(8.0, 0.0, 1.0)),
        ("uav/safety/state", state(0.0, state="MOVING", goal=goal, request=2, reason="busy")),
    ).tracks["uav"]
    assert track.accepted == [Spot(0.0, 1.0, 2.0, 3.0)]
    assert track.refused == [Spot(0.0, 9.0, 0.0, 1.0), Spot(0.0, 8.0, 0.0, 1.0)]


def test_phases_are_recorded_only_when_they_change():
    messages = [("uav/pose", pose(0)), ("uav/safety/state", state(0.0))]
    messages += [("uav/safety/state", state(0.0, request=1)), ("uav/safety/state", state(0.1))]
    messages += [("uav/safety/state", state(0.2, cage_on=False))]
    assert [p.cage_on for p in gathered(*messages).tracks["uav"].phases] == [True, False]


@pytest.mark.thorough
def test_two_vehicles_are_drawn_with_and_without_pressure_and_cage(tmp_path: Path):
    messages: list[Any] = [
        (f"uav{n}/pose", pose(seq, x=0.1 * n)) for n in (0, 1) for seq in range(5)
    ]
    messages += [("uav0/sensors/pressure", pressure(0.01 * seq, seq // 3)) for seq in range(5)]
    for ending in ("png", "svg"):
        draw(tmp_path / f"two.{ending}", gathered(*messages), "two")
        assert (tmp_path / f"two.{ending}").stat().st_size > 10_000


@pytest.mark.thorough
@pytest.mark.parametrize("poses", [1, 5])
def test_a_vehicle_at_rest_is_marked_at_its_place(tmp_path: Path, poses: int):
    from matplotlib import colors, image

    messages: list[Any] = [("uav/pose", pose(seq, x=0.0)) for seq in range(poses)]
    draw(tmp_path / "still.png", gathered(*messages), "still")
    picture = image.imread(tmp_path / "still.png")[..., :3]
    above = picture[: len(picture) // 2, : picture.shape[1] // 2]
    path = colors.to_rgb(figure.of_vehicles(["uav"])["uav"])
    assert (abs(above - path) < 0.02).all(axis=2).sum() > 20


def test_a_long_flight_keeps_few_points_and_always_the_last():
    curve: Curve[int] = Curve()
    for number in range(5 * MOST_POINTS):
        curve.add(number)
        assert curve[-1] == number
    assert len(curve) <= MOST_POINTS
    assert curve.added == 5 * MOST_POINTS
    assert {after - before for before, after in pairwise(curve[:-1])} == {8}
