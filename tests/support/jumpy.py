"""Runs a service whose Python sees the time of day jump: `jumpy.py FILE services.NAME`.

The file holds one int64: seconds to add to the time of day.
"""

import runpy
import sys
import time
from pathlib import Path

_file, _module = Path(sys.argv.pop(1)), sys.argv.pop(1)
_time, _time_ns = time.time, time.time_ns


def _ahead() -> int:
    return int.from_bytes(_file.read_bytes(), sys.byteorder, signed=True)


time.time = lambda: _time() + _ahead()
time.time_ns = lambda: _time_ns() + 1_000_000_000 * _ahead()
runpy.run_module(_module, run_name="__main__", alter_sys=True)
