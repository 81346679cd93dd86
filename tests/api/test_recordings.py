"""Recordings as arrays."""

import re
from pathlib import Path

import numpy as np
import pytest

import quadctl


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("recorded") / "flight.mcap"
    with quadctl.launch(params={"dynamics.speed": 0}, record=file) as run:
        run.vehicle.calibrate()
        run.vehicle.goto(1, 2, 1)
    return file


@pytest.mark.thorough
def test_a_recording_is_read_into_arrays_by_key_and_field(recording):
    flight = quadctl.read(recording)
    pose = flight["uav/pose"]
    count = len(pose["stamp"])
    assert count > 100
    assert pose["position"].shape == (count, 3)
    assert pose["orientation"].shape == (count, 4)
    assert pose["seq"].dtype == np.int64
    # In lock-step a pose without an answer is published again, e.g. the first on a busy machine.
    assert set(np.diff(pose["seq"])) <= {0, 1}
    assert np.linalg.norm(pose["position"][-1] - [1, 2, 1]) < 0.5
    assert np.allclose(np.linalg.norm(pose["orientation"], axis=1), 1)
    assert np.all(np.diff(pose["received"]) >= 0)
    state = flight["uav/safety/state"]
    assert state["cage_on"].dtype == bool
    assert {"HOVERING", "VERIFYING", "MOVING"} == set(state["state"])
    assert flight["uav/@call/goto"]["request"][0]["x"] == 1
    assert not any("scene" in key for key in flight)


@pytest.mark.thorough
def test_an_unambiguous_end_of_a_key_does_and_others_name_the_nearest(recording):
    flight = quadctl.read(recording)
    assert flight["pose"] is flight["uav/pose"]
    assert flight["safety/state"] is flight["state"] is flight["uav/safety/state"]
    assert "pose" not in flight
    assert "uav/pose" in flight
    assert flight.get("pose") is None
    assert len(flight) == len(list(flight)) == len(flight.keys())
    for error in (KeyError, quadctl.Invalid):
        with pytest.raises(error) as unknown:
            flight["posse"]
    assert str(unknown.value) == "the recording has no key posse"
    assert unknown.value.hint == "did you mean pose?"
    both = type(flight)({"uav0/pose": flight["pose"], "uav1/pose": flight["pose"]})
    with pytest.raises(quadctl.Invalid, match="pose is the end of several keys") as several:
        both["pose"]
    assert several.value.hint == "name one: uav0/pose, uav1/pose"


def test_a_recording_is_shown_in_short(recording):
    flight = quadctl.read(recording)
    count = len(flight["pose"]["stamp"])
    assert re.match(r"<recording of \d+\.\d s: .*\buav/pose \(\d+\),", str(flight))
    assert f"uav/pose ({count})" in repr(flight)
    assert len(repr(flight)) < 500
    assert repr(type(flight)()) == "<recording of 0.0 s: empty>"


def test_a_torn_recording_is_read_to_its_last_whole_record(recording, tmp_path):
    torn = tmp_path / "torn.mcap"
    data = recording.read_bytes()
    torn.write_bytes(data[: len(data) * 2 // 3])
    whole, part = quadctl.read(recording), quadctl.read(torn)
    assert part.keys() <= whole.keys()
    for key, columns in part.items():
        assert len(columns["received"]) <= len(whole[key]["received"])


def test_what_is_no_recording_is_refused(tmp_path):
    text = tmp_path / "text.mcap"
    text.write_text("no recording at all")
    for file in (text, tmp_path / "nowhere.mcap"):
        with pytest.raises(quadctl.Invalid, match=file.name):
            quadctl.read(file)
