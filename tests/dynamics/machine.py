"""The vehicle's machine code for the tests: made once for a checkout, in a dozen seconds."""

from pathlib import Path

import pytest

from services.dynamics.process.machine import Code, store, stored
from services.dynamics.process.making import made


def make(cache: Path) -> Code:
    """The code in this cache folder, where a process that is given it finds it too."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(cache))
        code = stored()
        if code is None:
            code = made()
            store(code)
        return code
