"""Code that numba compiles for the tests: by one worker for all, cached in the checkout."""

from types import ModuleType

import pytest

from quadctl.services.campaign.workers import load_kernel
from quadctl.services.dynamics.compiler import Code, made, store, stored
from quadctl.services.runtime.filelock import turn
from tests.support.lab import CACHE


def compiled_kernel() -> ModuleType:
    """Return the kernel of many vehicles; processes with this cache find it compiled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(CACHE))
        return load_kernel()


def compiled_vehicle() -> Code:
    """Return the machine code of one vehicle, cached for those processes too."""
    CACHE.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch, turn(CACHE / "vehicle.lock"):
        patch.setenv("XDG_CACHE_HOME", str(CACHE))
        code = stored()
        if code is None:
            code = made()
            store(code)
        return code
