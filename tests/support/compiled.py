"""What numba compiles for the tests: kept in the checkout, and made by one worker for all."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

import pytest

from quadctl.services.dynamics.compiled import kernel, source
from quadctl.services.dynamics.compiler import Code, made, store, stored
from quadctl.services.runtime.errors import AlreadyServed
from quadctl.services.runtime.filelock import FileLock
from tests.support.lab import CACHE


def compiled_kernel() -> ModuleType:
    """The kernel of many vehicles; a process with this cache finds it made."""
    with _turn("kernel"):
        return source.load_module("kernel", kernel.kernel_source())


def compiled_vehicle() -> Code:
    """The machine code of one vehicle, for those processes too."""
    with _turn("vehicle"):
        code = stored()
        if code is None:
            code = made()
            store(code)
        return code


@contextmanager
def _turn(what: str) -> Iterator[None]:
    """One after the other, with the checkout's cache in the environment."""
    CACHE.mkdir(exist_ok=True)
    lock = FileLock(CACHE / f"{what}.lock", what)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(CACHE))
        _take(lock)
        try:
            yield
        finally:
            lock.release()


def _take(lock: FileLock) -> None:
    # The test's own time limit ends a wait that is in vain.
    while True:
        try:
            lock.acquire()
        except AlreadyServed:
            time.sleep(0.2)
        else:
            return
