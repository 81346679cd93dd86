"""A recording with damaged bytes: all else is read, counted, and never made less."""

import os
import stat
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, strategies as st
from mcap.writer import CompressionType, Writer

from quadctl.services.runtime.errors import AlreadyServed, Invalid
from quadctl.services.runtime.recording.framing import summary
from quadctl.services.runtime.recording.reader import Bag, facts
from quadctl.services.runtime.recording.verify import check, repair, repair_in_place
from quadctl.services.runtime.recording.writer import Outfile
from tests.support.bags import flight, write

IN_CHUNK = 20
SENT = flight(300)
CHUNKS = -(-len(SENT) // IN_CHUNK)
PLACES = {"first": 0, "middle": CHUNKS // 2, "last": CHUNKS - 1}
HARM = {"length": 2, "long length": 7, "size": 9 + 16, "CRC": 9 + 24, "contents": 200}
"""Offsets in a chunk's record."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("bags") / "whole.mcap", SENT, every=IN_CHUNK)


def messages(path: Path) -> list[Any]:
    return [(m.key, m.payload, m.encoding, m.at, m.published) for m in Bag(path).messages()]


def spans(path: Path) -> list[tuple[int, int]]:
    """Return begin and end of each chunk."""
    index = summary(path)
    assert index is not None
    return [
        (each.chunk_start_offset, each.chunk_start_offset + each.chunk_length)
        for each in index.chunk_indexes
    ]


def flipped(whole: Path, folder: Path, *places: int, by: int = 0x11) -> Path:
    data = bytearray(whole.read_bytes())
    for place in places:
        data[place] ^= by
    path = folder / "damaged.mcap"
    path.write_bytes(data)
    return path


def without(*chunks: int) -> list[Any]:
    return [sent for number, sent in enumerate(SENT) if number // IN_CHUNK not in chunks]


@pytest.mark.parametrize("chunk", PLACES.values(), ids=PLACES)
@pytest.mark.parametrize("offset", HARM.values(), ids=HARM)
def test_all_but_a_damaged_chunk_is_read_and_what_is_lost_is_counted(
    whole: Path, tmp_path: Path, chunk: int, offset: int
):
    path = flipped(whole, tmp_path, spans(whole)[chunk][0] + offset)
    left = without(chunk)
    assert messages(path) == left
    found = facts(path)
    assert (found.messages, found.missing, found.cut) == (len(left), len(SENT) - len(left), "")
    assert found.damaged == 1
    assert found.problem.startswith("damaged in one place, where ")
    assert check(path).repairable
    assert check(path).faults[:2] == [
        f"it is {found.problem}", f"{found.missing} messages that its index counts cannot be read",
    ]  # fmt: skip
    done = repair_in_place(path)
    assert messages(path) == left
    assert check(path).messages == done.messages == len(left)
    assert done.original == path.with_name("damaged.mcap.damaged")
    assert facts(done.original).problem == found.problem


@pytest.mark.parametrize("chunk", PLACES.values(), ids=PLACES)
@pytest.mark.parametrize("bit", range(8))
def test_a_chunk_whose_kind_is_damaged_is_read_all_the_same(
    whole: Path, tmp_path: Path, chunk: int, bit: int
):
    path = flipped(whole, tmp_path, spans(whole)[chunk][0], by=1 << bit)
    assert messages(path) == SENT
    assert "a chunk is marked as something else" in facts(path).problem


@given(
    st.lists(st.tuples(st.floats(0, 1), st.integers(1, 255)), min_size=1, max_size=4),
    st.integers(1, 4000),
)
@example([(0.5, 1)], 4000)
@example([(0.999, 1)], 1)
def test_what_is_in_sound_chunks_is_read_wherever_bytes_are_damaged(
    whole: Path, harm: list[tuple[float, int]], longest: int
):
    size, bounds = whole.stat().st_size, spans(whole)
    data = bytearray(whole.read_bytes())
    places = set[int]()
    for number, (share, by) in enumerate(harm):
        begin = 8 + round(share * (size - 17))
        # The first one may be as long as some chunks.
        run = range(begin, min(begin + (longest if number == 0 else 1), size - 8))
        for place in run:
            data[place] ^= by
        places |= set(run)
    path = whole.with_name("flipped.mcap")
    path.write_bytes(data)
    touched = {n for n, (begin, end) in enumerate(bounds) if places & set(range(begin, end))}
    got, sound = messages(path), without(*touched)
    if 0 in touched and max(places) >= bounds[-1][1]:
        sound = []  # the channels stand in the first chunk, and again in the index
    rest = iter(SENT)
    assert all(each in rest for each in got), "in their order, each once, and none of its own"
    rest = iter(got)
    assert all(each in rest for each in sound)
    bag = Bag(path)
    assert len(list(bag.messages())) == len(got)
    assert bag.damaged or got == SENT


@pytest.mark.parametrize("compression", CompressionType, ids=lambda kind: kind.name.lower())
@pytest.mark.parametrize("chunked", [True, False], ids=["chunks", "no chunks"])
def test_a_file_of_another_program_is_read_around_its_damage(
    tmp_path: Path, compression: CompressionType, chunked: bool
):
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as out:
        mcap = Writer(out, 2000, compression, use_chunking=chunked)
        mcap.start("ros2", "another program")
        schema = mcap.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = mcap.register_channel("/talk", "cdr", schema)
        for number in range(500):
            mcap.add_message(channel, number, b"\0\1\0\0\x08\0\0\0" + b"%07d" % number, number)
        mcap.finish()
    assert facts(path).problem == ""
    data = bytearray(path.read_bytes())
    if chunked:
        places = [len(data) // 2, len(data) // 3]
    else:  # the length of one message, and the opcode of another one
        places = [
            data.index(b"%07d" % number) - 8 - 22 - 9 + at for number, at in ((100, 1), (250, 0))
        ]
    for place in places:
        data[place] ^= 0x20
    path.write_bytes(data)
    bag = Bag(path)
    read = [message.at for message in bag.messages()]
    assert len(read) > 350 if chunked else sorted({*range(500)} - {*read}) == [100, 250]
    assert read == sorted(set(read))
    assert bag.damaged or len(read) == 500, "a damaged index of a chunk loses nothing"
    checked = check(path)
    assert checked.unchecked == {"cdr": len(read)}


def test_with_a_damaged_index_nothing_is_lost(whole: Path, tmp_path: Path):
    path = flipped(whole, tmp_path, whole.stat().st_size - 300)
    found = facts(path)
    assert (found.messages, found.unread_bytes) == (len(SENT), 0)
    assert "its index is damaged" in found.problem
    assert repair_in_place(path).messages == len(SENT)
    assert facts(path).problem == ""


def test_a_damaged_beginning_is_read_past(whole: Path, tmp_path: Path):
    path = flipped(whole, tmp_path, 0, 3)
    assert messages(path) == SENT
    assert "at byte 0: its beginning is damaged" in facts(path).problem


def test_a_repair_keeps_link_owner_and_mode(whole: Path, tmp_path: Path):
    path = flipped(whole, tmp_path, spans(whole)[3][0] + 200)
    path.chmod(0o640)
    with suppress(OSError):  # only root may, and only if its namespace has that user
        os.chown(path, 1234, 2345)
    was = path.stat()
    link = tmp_path / "link.mcap"
    link.symlink_to(path.name)
    assert repair_in_place(link).messages == len(SENT) - IN_CHUNK
    assert link.is_symlink()
    now = path.stat()
    assert (now.st_uid, now.st_gid) == (was.st_uid, was.st_gid)
    assert stat.S_IMODE(now.st_mode) == 0o640
    assert facts(path).problem == ""
    assert sorted(each.name for each in tmp_path.iterdir()) == [
        "damaged.mcap", "damaged.mcap.damaged", "link.mcap",
    ]  # fmt: skip


def test_no_original_takes_the_place_of_an_older_one(whole: Path, tmp_path: Path):
    for name in ("damaged.mcap.damaged", "damaged.mcap.damaged-1"):
        path = flipped(whole, tmp_path, spans(whole)[3][0] + 200)
        assert repair_in_place(path).original == tmp_path / name


def refuses(path: Path, error: type[Exception], text: str) -> None:
    before = {each: each.read_bytes() for each in path.parent.iterdir()}
    with pytest.raises(error, match=text):
        repair_in_place(path)
    assert {each: each.read_bytes() for each in path.parent.iterdir()} == before


def test_a_file_with_another_name_is_not_replaced(whole: Path, tmp_path: Path):
    path = flipped(whole, tmp_path, spans(whole)[3][0] + 200)
    (tmp_path / "other.mcap").hardlink_to(path)
    refuses(path, Invalid, "hard link")


def test_a_sound_recording_is_not_touched(whole: Path, tmp_path: Path):
    path = tmp_path / "sound.mcap"
    path.write_bytes(whole.read_bytes())
    before = path.stat()
    assert repair_in_place(path).why == ""
    after = path.stat()
    # Not the time of the last access: the check reads it.
    assert (after.st_ino, after.st_mtime_ns, after.st_ctime_ns, after.st_size) == (
        before.st_ino, before.st_mtime_ns, before.st_ctime_ns, before.st_size,
    )  # fmt: skip


def test_a_recording_in_use_is_neither_repaired_nor_called_damaged(whole: Path, tmp_path: Path):
    path = tmp_path / "live.mcap"
    out = Outfile.create(path)
    out.write(whole.read_bytes()[:20_000])
    out.flush()
    assert facts(path).problem == "cut: it is still being recorded"
    refuses(path, AlreadyServed, "still being recorded")
    out.close()
    assert facts(path).problem == "cut: it ends in the middle"
    assert repair_in_place(path).original is None


def test_a_file_that_cannot_be_read_at_all_is_not_repaired(tmp_path: Path):
    path = tmp_path / "none.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + bytes(1000) + b"\x89MCAP0\r\n")
    assert facts(path).messages == 0
    done = repair(path, tmp_path / "new.mcap")
    assert (done.messages, done.dropped) == (0, 1008)
