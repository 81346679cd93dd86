"""Start of one of our modules by a fork of this process, which has loaded most of it already.

It takes 15 ms instead of 100 ms for a fresh interpreter, and the loaded pages are shared. Only a
process with a single thread may fork, and only on Linux; otherwise callers start an interpreter.
"""

import gc
import os
import runpy
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Mapping
from typing import IO, NoReturn

_MOST_FILES = 4096
"""Upper limit on the open descriptors of a launching process."""
_THREADS = "/proc/self/task"
_POLL = 0.002


def possible() -> bool:
    """Return whether this process may fork now: it has one thread, Zenoh's included."""
    return sys.platform == "linux" and len(os.listdir(_THREADS)) == 1  # noqa: PTH208 - pathlib is slow


class ForkedProcess:
    """A forked module in a new session, with the needed part of subprocess.Popen's interface.

    Its stdin and stdout are pipes; with `both`, stderr goes into stdout's pipe as well.
    """

    def __init__(
        self, module: str, environment: Mapping[str, str], folder: str, *, both: bool
    ) -> None:
        child_in, ours_in = os.pipe()
        ours_out, child_out = os.pipe()
        sys.stdout.flush()
        sys.stderr.flush()
        # A garbage collection would write to the loaded objects, and their pages are shared.
        gc.freeze()
        self._module = module
        self._code: int | None = None
        self.pid = os.fork()
        if self.pid == 0:
            _become(module, environment, folder, (child_in, child_out, child_out if both else 2))
        os.close(child_in)
        os.close(child_out)
        self.stdin: IO[bytes] = os.fdopen(ours_in, "wb")
        self.stdout: IO[bytes] = os.fdopen(ours_out, "rb")

    def poll(self) -> int | None:
        """Return its exit code, None while it runs."""
        if self._code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self._code = os.waitstatus_to_exitcode(status) if pid else None
        return self._code

    def wait(self, timeout: float) -> int:
        """Return its exit code; raises subprocess.TimeoutExpired if it runs after `timeout` s."""
        deadline = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() >= deadline:
                raise subprocess.TimeoutExpired(self._module, timeout)
            time.sleep(_POLL)
        return code

    def send_signal(self, number: int) -> None:
        """Signal the process, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)


def _become(
    module: str, environment: Mapping[str, str], folder: str, streams: tuple[int, int, int]
) -> NoReturn:
    """Run the module in the child, then exit."""
    code = 1
    try:
        os.setsid()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        for stream, descriptor in enumerate(streams):
            os.dup2(descriptor, stream)
        # A child must not hold other children's pipes or the realm's lock after the supervisor.
        os.closerange(3, _MOST_FILES)
        os.chdir(folder)
        os.environ.update(environment)
        sys.argv = [module]
        # runpy warns about a module that is already loaded.
        sys.modules.pop(module, None)
        runpy.run_module(module, run_name="__main__", alter_sys=True)
        code = 0
    except SystemExit as leaving:
        code = leaving.code if isinstance(leaving.code, int) else 0
    except BaseException:  # noqa: BLE001 - last frame of the process: print it and exit
        traceback.print_exc()
    finally:
        try:
            sys.stderr.flush()
        finally:  # whatever happens, the child never goes on as its parent
            os._exit(code)
