"""A recording is a file that the library's own reader opens, every schema attached."""

import errno
import json
import os
import resource
from contextlib import contextmanager

import pytest
from mcap.reader import make_reader

from quadctl.schemas.messages import Pose, Pressure, SafetyState
from quadctl.services.recorder.recording import Recording
from quadctl.services.runtime.errors import Invalid, QuadctlError
from quadctl.services.runtime.recording.reader import Bag
from quadctl.services.runtime.recording.writer import Outfile
from tests.support.bags import flight, pose, state, taken, write


@contextmanager
def room_for(size: int):
    """No file of this process may grow beyond a size."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_device_is_told():
    out = Outfile(os.open("/dev/full", os.O_WRONLY))
    out.write(b"something")
    with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
        out.flush()
    out.close()


def test_a_part_of_what_was_flushed_is_never_there(tmp_path):
    out = Outfile.create(tmp_path / "f")
    out.write(b"x" * 600)
    out.flush()
    out.write(b"y" * 600)
    with room_for(1000), pytest.raises(OSError, match=os.strerror(errno.EFBIG)):
        out.flush()
    assert (out.size, (tmp_path / "f").read_bytes()) == (600, b"x" * 600)
    out.close()


def test_a_recording_on_a_full_disk_stops_and_says_what_to_do(tmp_path):
    recording = Recording(tmp_path / "r.mcap", {})
    said, kept = flight(2000), [0]

    def fill() -> None:
        while True:
            recording.take(said[kept[-1] : kept[-1] + 50])
            recording.flush()
            kept.append(kept[-1] + 50)

    with room_for(8_000), pytest.raises(QuadctlError) as raised:
        fill()
    assert "the recording has stopped" in raised.value.message
    assert f"quadctl bag repair {recording.path}" in raised.value.hint
    assert raised.value.exit_code == 1
    # All that was taken before is there.
    there = [m.payload for m in Bag(recording.path).messages() if not m.derived]
    assert there == [each.payload for each in said[: kept[-1]]]
    assert kept[-1]


def test_where_not_even_the_head_has_room_there_is_no_file(tmp_path):
    with room_for(20), pytest.raises(QuadctlError, match="File too large"):
        Recording(tmp_path / "r.mcap", {})
    assert not (tmp_path / "r.mcap").exists()


def test_no_recording_is_written_over(tmp_path):
    (tmp_path / "r.mcap").write_bytes(b"old")
    with pytest.raises(Invalid, match="is there already"):
        Recording(tmp_path / "r.mcap", {})
    assert (tmp_path / "r.mcap").read_bytes() == b"old"


@pytest.fixture
def recorded(tmp_path):
    recording = Recording(tmp_path / "r.mcap", {"params": "{}"})
    recording.take(flight())
    recording.end()
    return recording.path


def test_the_librarys_reader_finds_every_message_with_its_schema(recorded):
    with recorded.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = [(s, c, m) for s, c, m in reader.iter_messages()]
        summary = reader.get_summary()
        notes = {note.name: note.metadata for note in reader.iter_metadata()}
    kinds = {(c.topic, s.name if s else None) for s, c, _ in found}
    assert kinds == {
        ("uav/pose", "quadctl.Pose"),
        ("uav/sensors/pressure", "quadctl.Pressure"),
        ("uav/safety/state", "quadctl.SafetyState"),
        ("my/own", None),
        ("/tf", "foxglove.FrameTransform"),
        ("/scene", "foxglove.SceneUpdate"),
    }
    assert all(s.encoding == "jsonschema" and json.loads(s.data) for s, _, _ in found if s)
    assert summary.statistics.message_count == len(found) == 100 + 10 + 1 + 10 + 100 + 1
    assert notes == {"quadctl": {"params": "{}"}}
    times = [m.log_time for _, _, m in found]
    assert times == sorted(times)
    assert all(m.publish_time == m.log_time - 1000 for _, c, m in found if c.topic[0] != "/")


def test_what_was_recorded_comes_back_as_it_was_on_the_bus(tmp_path):
    said = flight()
    bag = Bag(write(tmp_path / "f.mcap", said))
    assert [(m.key, m.payload, m.encoding, m.at, m.published) for m in bag.messages()] == said
    assert bag.cut == ""


def test_key_with_messages_of_different_types_keeps_all(tmp_path):
    said = [
        taken("uav/pose", pose(0), 0),
        taken("uav/pose", b"nonsense", 0.1, "text/plain"),
        taken("uav/pose", {"mine": 1}, 0.2, "application/msgpack"),
        taken("uav/pose", b'{"mine": 1}', 0.3, "application/json"),
    ]
    bag = Bag(write(tmp_path / "f.mcap", said))
    assert [m.payload for m in bag.messages()] == [each.payload for each in said]


def test_every_vehicle_has_a_frame_and_a_cage_of_its_own(tmp_path):
    recording = Recording(tmp_path / "r.mcap", {})
    for vehicle in ("uav0", "uav1"):
        recording.take([taken(f"{vehicle}/pose", pose(0), 0)])
        recording.take([taken(f"{vehicle}/safety/state", state(0), 0)])
    recording.end()
    found = [(m.key, m.value) for m in Bag(recording.path).messages() if m.derived]
    assert [v["child_frame_id"] for key, v in found if key == "/tf"] == ["uav0", "uav1"]
    ids = [e["id"] for key, v in found if key == "/scene" for e in v["entities"]]
    assert len(ids) == len(set(ids)) == 6


def test_the_types_that_a_viewer_draws_are_ours_too(recorded):
    types = {"uav/pose": Pose, "uav/sensors/pressure": Pressure, "uav/safety/state": SafetyState}
    for message in Bag(recorded).messages():
        if message.key in types:
            assert set(message.value) == set(types[message.key].__struct_fields__)
