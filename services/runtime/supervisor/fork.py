"""Start of a module of ours by a fork of this process, which has most of it loaded already.

Ready in 15 ms instead of 100 for a fresh interpreter, and the loaded pages are shared. Only a
process with a single thread may be forked, and only on Linux; otherwise callers start a fresh
interpreter.
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
"""More descriptors than a launching process has open."""
_THREADS = "/proc/self/task"
_POLL = 0.002


def possible() -> bool:
    """Whether this process may be forked now: it has one thread, Zenoh's own counted too."""
    return sys.platform == "linux" and len(os.listdir(_THREADS)) == 1  # noqa: PTH208 - pathlib is slow


class ForkedProcess:
    """A forked module in a session of its own: what is used of subprocess.Popen.

    Its stdin and stdout are pipes; with `both`, stderr goes into stdout's pipe as well.
    """

    def __init__(
        self, module: str, environment: Mapping[str, str], folder: str, *, both: bool
    ) -> None:
        child_in, ours_in = os.pipe()
        ours_out, child_out = os.pipe()
        sys.stdout.flush()
        sys.stderr.flush()
        # What is loaded stays where it is in all copies, and so stays shared.
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
        """How it ended, None while it runs."""
        if self._code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self._code = os.waitstatus_to_exitcode(status) if pid else None
        return self._code

    def wait(self, timeout: float) -> int:
        """How it ended; raises subprocess.TimeoutExpired where it has not within `timeout` s."""
        deadline = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() >= deadline:
                raise subprocess.TimeoutExpired(self._module, timeout)
            time.sleep(_POLL)
        return code

    def send_signal(self, number: int) -> None:
        """Signal it, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)


def _become(
    module: str, environment: Mapping[str, str], folder: str, streams: tuple[int, int, int]
) -> NoReturn:
    """Be the module, in the child, and end with it."""
    code = 1
    try:
        os.setsid()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        for stream, descriptor in enumerate(streams):
            os.dup2(descriptor, stream)
        # Among them the ends of other children's pipes and the realm's lock: held by a child
        # they would outlive the supervisor.
        os.closerange(3, _MOST_FILES)
        os.chdir(folder)
        os.environ.update(environment)
        sys.argv = [module]
        # Loaded here under its own name already; runpy warns of one that it finds so.
        sys.modules.pop(module, None)
        runpy.run_module(module, run_name="__main__", alter_sys=True)
        code = 0
    except SystemExit as leaving:
        code = leaving.code if isinstance(leaving.code, int) else 0
    except BaseException:  # noqa: BLE001 - the last frame of a process: it is told, and ends
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)
