"""What is gathered for a picture: paths by boot and vehicle, verdicts, phases."""

from pathlib import Path
from typing import Any

import pytest

from quadctl.cli.plot import figure
from quadctl.cli.plot.figure import draw
from quadctl.cli.plot.track import RecordedFlight, Spot
from quadctl.schemas.messages import Position, Waypoint
from tests.support.bags import pose, pressure, refused, state, taken


def gathered(*said) -> RecordedFlight:
    flight = RecordedFlight()
    for key, message in said:
        one = taken(key, message, 0)
        flight.add(one.key, one.payload, one.encoding)
    return flight


def test_a_new_boot_goes_on_in_time_and_begins_a_leg():
    said = [("uav/pose", pose(seq)) for seq in range(3)]
    said += [("uav/pose", pose(seq, boot="b1")) for seq in range(2)]
    track = gathered(*said).tracks["uav"]
    assert [len(leg) for leg in track.legs] == [3, 2]
    assert [point[0] for point in track.path] == [0.0, 0.01, 0.02, 0.02, 0.03]
    assert track.boots == [0.02]


def test_every_vehicle_has_its_own_track():
    flight = gathered(("uav0/pose", pose(0)), ("uav1/pose", pose(0)), ("uav2/info", state(0)))
    assert list(flight.flown()) == ["uav0", "uav1"]


def test_what_was_refused_is_known_by_the_call_and_by_the_state():
    goal = Position(1.0, 2.0, 3.0)
    track = gathered(
        ("uav/pose", pose(0)),
        ("uav/@call/goto", refused(9, 0, 1)),
        ("uav/safety/state", state(0.0, state="MOVING", goal=goal)),
        ("uav/input/position_request", Waypoint(8.0, 0.0, 1.0)),
        ("uav/safety/state", state(0.0, state="MOVING", goal=goal, request=2, reason="busy")),
    ).tracks["uav"]
    assert track.taken == [Spot(0.0, 1.0, 2.0, 3.0)]
    assert track.refused == [Spot(0.0, 9.0, 0.0, 1.0), Spot(0.0, 8.0, 0.0, 1.0)]


def test_phases_are_told_by_their_changes_alone():
    said = [("uav/pose", pose(0)), ("uav/safety/state", state(0.0))]
    said += [("uav/safety/state", state(0.0, request=1)), ("uav/safety/state", state(0.1))]
    said += [("uav/safety/state", state(0.2, cage_on=False))]
    assert [p.cage_on for p in gathered(*said).tracks["uav"].phases] == [True, False]


def test_two_vehicles_are_drawn_with_and_without_air_and_cage(tmp_path: Path):
    said: list[Any] = [(f"uav{n}/pose", pose(seq, x=0.1 * n)) for n in (0, 1) for seq in range(5)]
    said += [("uav0/sensors/pressure", pressure(0.01 * seq, seq // 3)) for seq in range(5)]
    for ending in ("png", "svg"):
        draw(tmp_path / f"two.{ending}", gathered(*said), "two")
        assert (tmp_path / f"two.{ending}").stat().st_size > 10_000


@pytest.mark.parametrize("poses", [1, 5])
def test_who_stood_still_has_a_mark_at_the_place(tmp_path: Path, poses: int):
    from matplotlib import colors, image

    said: list[Any] = [("uav/pose", pose(seq, x=0.0)) for seq in range(poses)]
    draw(tmp_path / "still.png", gathered(*said), "still")
    picture = image.imread(tmp_path / "still.png")[..., :3]
    above = picture[: len(picture) // 2, : picture.shape[1] // 2]
    path = colors.to_rgb(figure.of_vehicles(["uav"])["uav"])
    assert (abs(above - path) < 0.02).all(axis=2).sum() > 20
