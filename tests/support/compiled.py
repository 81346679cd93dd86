"""Code that numba compiles for the tests: by one worker for all, cached in the checkout."""

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
    """Return the kernel of many vehicles; processes with this cache find it compiled."""
    with _turn("kernel"):
        return source.load_module("kernel", kernel.kernel_source())


def compiled_vehicle() -> Code:
    """Return the machine code of one vehicle, cached for those processes too."""
    with _turn("vehicle"):
        code = stored()
        if code is None:
            code = made()
            store(code)
        return code


@contextmanager
def _turn(what: str) -> Iterator[None]:
    """Lock out the other workers, with the checkout's cache in the environment."""
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
    # The test's time limit ends a wait that is too long.
    while True:
        try:
            lock.acquire()
        except AlreadyServed:
            time.sleep(0.2)
        else:
            return
