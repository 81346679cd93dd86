"""Code that numba compiles for the tests: by one worker for all, cached in the checkout."""

from types import ModuleType

import pytest

from quadctl.services.campaign.workers import load_kernel
from quadctl.services.dynamics.compiler import Code, compile_once, stored
from tests.support.lab import CACHE


def compiled_kernel() -> ModuleType:
    """Return the kernel of many vehicles; processes with this cache find it compiled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(CACHE))
        return load_kernel()


def compiled_vehicle() -> Code:
    """Return the machine code of one vehicle, cached for those processes too."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(CACHE))
        compile_once()
        code = stored()
    assert code is not None
    return code
