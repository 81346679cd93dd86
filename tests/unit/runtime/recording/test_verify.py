"""A recording cut at any byte is read up to there and repaired; what is not whole is found."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings, strategies as st
from mcap.reader import make_reader

from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.recording.reader import Bag, facts
from quadctl.services.runtime.recording.verify import check, repair
from tests.support.bags import flight, raw_message, write


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("bags") / "whole.mcap", flight(200))


def messages(path: Path) -> list[Any]:
    return [(m.key, m.payload, m.encoding, m.at, m.published) for m in Bag(path).messages()]


def cut(whole: Path, length: int, name: str = "cut.mcap") -> Path:
    path = whole.with_name(name)
    path.write_bytes(whole.read_bytes()[:length])
    return path


@pytest.mark.thorough
@settings(max_examples=150)
@given(st.floats(0, 1))
@example(0.0)
@example(1.0)
def test_a_file_cut_anywhere_is_repaired_with_all_complete_chunks(whole, part):
    length = round(part * whole.stat().st_size)
    check_cut(whole, length)


@pytest.mark.prove
@pytest.mark.timeout(600)
def test_cut_at_every_length(whole):
    for length in range(whole.stat().st_size + 1):
        check_cut(whole, length)


def check_cut(whole: Path, length: int) -> None:
    torn, repaired = cut(whole, length), whole.with_name("repaired.mcap")
    repaired.unlink(missing_ok=True)
    done = repair(torn, repaired)
    kept = messages(repaired)
    assert kept == messages(torn) == messages(whole)[: done.messages]
    assert bool(done.why) == (length < whole.stat().st_size)
    with repaired.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert len(list(reader.iter_messages())) == done.messages
    assert check(repaired) == (done.messages, [], {}, False)
    assert facts(torn).messages == facts(repaired).messages == done.messages
    assert facts(repaired).cut == ""


def test_no_flushed_message_is_lost(tmp_path):
    sent = flight(200)
    torn = write(tmp_path / "killed.mcap", sent, every=25, whole=False)
    flushed = len(sent) // 25 * 25
    assert repair(torn, tmp_path / "repaired.mcap").messages == flushed
    assert messages(tmp_path / "repaired.mcap") == sent[:flushed]


def test_a_file_that_is_no_recording_is_rejected_without_output(tmp_path):
    other = tmp_path / "text.mcap"
    other.write_text("no recording at all")
    with pytest.raises(Invalid, match="is not a recording"):
        repair(other, tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


def test_lost_and_misordered_messages_are_found(tmp_path):
    sent = [each for number, each in enumerate(flight(50)) if number not in {20, 21}]
    path = write(tmp_path / "gaps.mcap", sent)
    assert check(path).faults == ["uav/pose: 2 messages are missing"]
    back = write(
        tmp_path / "back.mcap", [raw_message("a/b", {}, 1.0, ""), raw_message("a/b", {}, 0.5, "")]
    )
    assert check(back).faults == ["a/b: a message is 0.5 s older than the previous one"]
