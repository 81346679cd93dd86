"""Recordings: readable by the MCAP library, with all schemas, and safe on a full disk."""

import errno
import gc
import json
import os
import resource
import tracemalloc
from contextlib import contextmanager
from pathlib import Path

import pytest
from mcap.reader import make_reader

from quadctl.schemas.messages import Pose, Pressure, SafetyState, Zone, Zones
from quadctl.schemas.zones import CircleParams, ZoneParams
from quadctl.services.recorder.recording import Recording
from quadctl.services.runtime import procfs
from quadctl.services.runtime.errors import Invalid, QuadctlError
from quadctl.services.runtime.recording import writer
from quadctl.services.runtime.recording.reader import Bag
from quadctl.services.runtime.recording.writer import Outfile
from tests.support.bags import flight, pose, raw_message, state, write
from tests.support.proofs import Proofs


@contextmanager
def room_for(size: int):
    """Limit the size of this process's files."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_device_raises_an_error():
    out = Outfile(os.open("/dev/full", os.O_WRONLY))
    out.write(b"something")
    with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
        out.flush()
    out.close()


def test_a_failed_flush_leaves_no_partial_data(tmp_path):
    out = Outfile.create(tmp_path / "f")
    out.write(b"x" * 600)
    out.flush()
    out.write(b"y" * 600)
    with room_for(1000), pytest.raises(OSError, match=os.strerror(errno.EFBIG)):
        out.flush()
    assert (out.size, (tmp_path / "f").read_bytes()) == (600, b"x" * 600)
    out.close()


def test_a_recording_on_a_full_disk_stops_with_a_hint(tmp_path):
    recording = Recording(tmp_path / "r.mcap", {})
    sent, kept = flight(2000), [0]

    def fill() -> None:
        while True:
            recording.take(sent[kept[-1] : kept[-1] + 50])
            recording.flush()
            kept.append(kept[-1] + 50)

    with room_for(8_000), pytest.raises(QuadctlError) as raised:
        fill()
    assert "the recording has stopped" in raised.value.message
    assert f"quadctl bag repair {recording.path}" in raised.value.hint
    assert raised.value.exit_code == 1
    # All messages flushed before are in the file.
    there = [m.payload for m in Bag(recording.path).messages() if not m.derived]
    assert there == [each.payload for each in sent[: kept[-1]]]
    assert kept[-1]


def test_keys_beyond_the_most_of_a_file_are_counted_and_the_others_go_on(tmp_path, monkeypatch):
    monkeypatch.setattr(writer, "MOST_CHANNELS", 3)
    recording = Recording(tmp_path / "r.mcap", {})
    sent = [
        raw_message(f"own/{number % 5}", b"%d" % number, 0.0, "text/plain") for number in range(20)
    ]
    recording.take(sent)
    recording.end()
    there = [m.payload for m in Bag(recording.path).messages()]
    assert there == [each.payload for number, each in enumerate(sent) if number % 5 < 3]
    facts = recording.facts("done")
    assert (facts["messages"], facts["keys"], facts["lost"]) == (12, 3, 8)


def test_a_recording_that_is_large_enough_takes_no_more(tmp_path: Path):
    recording, sent = Recording(tmp_path / "r.mcap", {}, most=2_000), flight(100)
    for message in sent:
        recording.take([message])
        recording.flush()
    recording.end()
    there = [m.payload for m in Bag(recording.path).messages() if not m.derived]
    assert 0 < len(there) < len(sent)
    assert there == [each.payload for each in sent[: len(there)]]


def test_without_space_for_the_header_no_file_is_created(tmp_path):
    with room_for(20), pytest.raises(QuadctlError, match="File too large"):
        Recording(tmp_path / "r.mcap", {})
    assert not (tmp_path / "r.mcap").exists()


def test_an_existing_recording_is_not_overwritten(tmp_path):
    (tmp_path / "r.mcap").write_bytes(b"old")
    with pytest.raises(Invalid, match="already exists"):
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


def test_recorded_messages_equal_those_on_the_bus(tmp_path):
    sent = flight()
    bag = Bag(write(tmp_path / "f.mcap", sent))
    assert [(m.key, m.payload, m.encoding, m.at, m.published) for m in bag.messages()] == sent
    assert bag.cut == ""


def test_a_key_with_messages_of_different_types_keeps_all(tmp_path):
    sent = [
        raw_message("uav/pose", pose(0), 0),
        raw_message("uav/pose", b"nonsense", 0.1, "text/plain"),
        raw_message("uav/pose", {"mine": 1}, 0.2, "application/msgpack"),
        raw_message("uav/pose", b'{"mine": 1}', 0.3, "application/json"),
    ]
    bag = Bag(write(tmp_path / "f.mcap", sent))
    assert [m.payload for m in bag.messages()] == [each.payload for each in sent]


def test_every_vehicle_has_its_own_frame_cage_and_zones(tmp_path):
    recording = Recording(tmp_path / "r.mcap", {})
    for vehicle in ("uav0", "uav1"):
        recording.take([raw_message(f"{vehicle}/pose", pose(0), 0)])
        recording.take([raw_message(f"{vehicle}/safety/state", state(0), 0)])
        pond = ZoneParams("pond", circle=CircleParams(1.0, 0.0, 0.5))
        recording.take([raw_message(f"{vehicle}/safety/zones", Zones((Zone.of(pond),)), 0)])
    recording.end()
    found = [(m.key, m.value) for m in Bag(recording.path).messages() if m.derived]
    assert [v["child_frame_id"] for key, v in found if key == "/tf"] == ["uav0", "uav1"]
    ids = [e["id"] for key, v in found if key == "/scene" for e in v["entities"]]
    assert len(ids) == len(set(ids)) == 8
    assert {"uav0/zone/pond", "uav1/zone/pond"} < set(ids)


def test_drawn_topics_keep_the_fields_of_their_types(recorded):
    types = {"uav/pose": Pose, "uav/sensors/pressure": Pressure, "uav/safety/state": SafetyState}
    for message in Bag(recorded).messages():
        if message.key in types:
            assert set(message.value) == set(types[message.key].__struct_fields__)


FLUSHES = 4
"""Chunks that the recorder writes each second."""
KEYS = 20


def memory_while_recording(path: Path, seconds: int) -> list[int]:
    """Record a second's poses of vehicles for each second; return the memory (bytes) at each tenth."""
    recording, found = Recording(path, {}), []
    messages = [raw_message(f"uav{n % KEYS}/pose", pose(n), n / 100) for n in range(100)]
    part = len(messages) // FLUSHES
    for second in range(seconds):
        for begin in range(0, len(messages), part):
            recording.take(messages[begin : begin + part])
            recording.flush()
        if (second + 1) % (seconds // 10) == 0:
            gc.collect()
            found.append(procfs.stats_of(os.getpid()).rss or 0)
    recording.end()
    return found


def held() -> int:
    """Return the bytes in memory that the recorder's modules and the library of MCAP hold.

    Threads of other tests in this process hold more and more.
    """
    of = [
        tracemalloc.Filter(True, f"*/{part}/*")
        for part in ("services/runtime/recording", "services/recorder", "mcap")
    ]
    return sum(trace.size for trace in tracemalloc.take_snapshot().filter_traces(of).traces)


def test_a_long_recording_takes_no_more_memory(tmp_path: Path):
    tracemalloc.start()
    try:
        recording = Recording(tmp_path / "r.mcap", {})
        sizes = []
        for _ in range(2):
            for message in flight(150):
                recording.take([message])
                recording.flush()
            sizes.append(held())
    finally:
        tracemalloc.stop()
    recording.end()
    # Of 200 entries of the index, in memory, a third would be more.
    assert sizes[1] - sizes[0] < 20_000
    with (tmp_path / "r.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) > 300


@pytest.mark.prove
@pytest.mark.timeout(600)
def test_an_hour_of_recording_takes_constant_memory(tmp_path: Path, proofs: Proofs):
    used = memory_while_recording(tmp_path / "r.mcap", 3600)
    grown = (used[-1] - used[0]) / 1e6
    proofs.add(
        f"a recording of an hour of 100 messages a second on {KEYS} keys, written at full speed: growth of"
        " the process from the 6th minute to the last",
        f"{grown:.1f} MB",
        "under 2 MB",
    )
    assert grown < 2.0
