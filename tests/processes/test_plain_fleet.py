"""Several vehicles where the extra `fleet` is not installed: as many as plain Python can fly."""

import pytest

from tests.processes.lab import Lab

HIDDEN = """
from importlib import util

find = util.find_spec
util.find_spec = lambda name, package=None: None if name == "numba" else find(name, package)
"""


@pytest.fixture
def without_numba(lab: Lab) -> Lab:
    """A lab in whose processes numba is not found."""
    (lab.folder / "sitecustomize.py").write_text(HIDDEN, encoding="utf-8")
    lab.environment["PYTHONPATH"] = str(lab.folder)
    return lab


def test_more_than_this_machine_can_fly_are_refused_before_anything_starts(without_numba: Lab):
    lab = without_numba
    # A million steps' worth a second, where plain Python does a few hundred thousand at most.
    done = lab.quadctl("up", "-d", "--vehicles", 200, "--set", "dynamics.rate=1000")
    assert done.code == 2
    assert "vehicles at 1000 Hz in plain Python, 200 were asked for" in done.err
    assert "pip install 'quadctl[fleet]'" in done.err
    assert done.out == ""
    assert not lab.home.exists()
    assert lab.quadctl("status").code == 3


def test_a_few_start_and_fly(without_numba: Lab):
    lab = without_numba
    lab.start("--vehicles", 2, "--set", "dynamics.rate=20")
    done = lab.quadctl("fleet", "goto", "0", "0", "1.5", timeout=60)
    assert done.code == 0, done.err
    assert "compil" not in lab.log("dynamics")
