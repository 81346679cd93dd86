"""Work that one worker of a test run does for all."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from quadctl.services.runtime.filelock import turn


def once(factory: pytest.TempPathFactory, name: str, fill: Callable[[Path], object]) -> Path:
    """Return a folder that the run's first caller has filled by `fill`; the others wait for it."""
    base = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent  # shared by the workers of a run
    folder, done = base / name, base / f"{name}.done"
    with turn(base / f"{name}.lock"):
        if not done.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            fill(folder)
            done.touch()
    return folder
