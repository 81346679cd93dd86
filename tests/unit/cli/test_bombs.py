"""Recordings made to be huge, endless or malformed, read in little memory."""

import resource
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.bombs import BOMBS, Bomb
from tests.support.command_line import Quadctl

ROOM = 1 << 30
"""Bytes that a command may take more than now; the bombs hold up to 8 times as many."""


@pytest.fixture
def made(request: pytest.FixtureRequest) -> Bomb:
    return BOMBS[request.param]()


@pytest.fixture
def little_memory(made: Bomb) -> Iterator[None]:
    """Limit the memory of this process once the bomb is made, so that no fault in the product can take the machine's."""
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + ROOM, hard))
    yield
    resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@pytest.mark.thorough
@pytest.mark.usefixtures("little_memory")
@pytest.mark.parametrize("made", BOMBS, indirect=True)
def test_a_recording_made_to_do_harm_is_refused_or_read(
    quadctl: Quadctl, tmp_path: Path, made: Bomb
):
    bomb = tmp_path / "bomb.mcap"
    bomb.write_bytes(made.data)
    lines = {
        "bag info": {0, 6},
        "bag check": {0, 6, 8},
        "bag repair -o mended.mcap": {0, 6},
        "bag export --csv -o tables": {0, 6},
        "plot -o flight.png": {6},
    }
    for line, codes in lines.items():
        done = quadctl(*line.split(), "bomb.mcap")
        assert done.code in codes, (line, done)
        assert "Traceback" not in done.err, (line, done)
        if line == "bag check":
            assert made.said in done.out + done.err
    assert bomb.read_bytes() == made.data
    assert {path.name for path in tmp_path.iterdir()} <= {"bomb.mcap", "mended.mcap", "tables"}


def test_a_refused_recording_is_not_repaired_in_place(quadctl: Quadctl, tmp_path: Path):
    bomb = tmp_path / "bomb.mcap"
    made = BOMBS["8 GiB by zstd"]()
    bomb.write_bytes(made.data)
    assert quadctl("bag", "repair", "bomb.mcap").code == 6
    assert bomb.read_bytes() == made.data
    assert [path.name for path in tmp_path.iterdir()] == ["bomb.mcap"]
