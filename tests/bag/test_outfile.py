"""What the disk does not take is not there, and is told."""

import errno
import os
import resource
from contextlib import contextmanager

import pytest

from quadctl.services.recorder.recording import Recording
from quadctl.services.runtime.errors import Invalid, QuadctlError
from quadctl.services.runtime.recording.reader import Bag
from quadctl.services.runtime.recording.writer import Outfile
from tests.bag.made import flight


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
