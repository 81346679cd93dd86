"""The supervisor's own process behind `quadctl up -d`.

Reads a Launch, one line, from stdin, and writes one Settled to stdout when all are ready or one failed.
A run that is owned ends when its stdin does: with its owner, even by kill -9, on every platform.
"""

import os
import sys
import threading
from pathlib import Path

import msgspec

from services.runtime.errors import QuadctlError
from services.runtime.run import up
from services.runtime.run.detach import Settled
from services.runtime.run.launch import Launch
from services.runtime.run.supervise import Supervisor


def main() -> int:
    """Run a realm in the background."""
    # Not sys.stdin, which is None where the shell had closed it (`quadctl up -d <&-`).
    with os.fdopen(0, "rb", closefd=False) as pipe:
        asked = pipe.readline()
    if not asked.endswith(b"\n"):
        return 0  # who asked was killed over it
    launch = msgspec.json.decode(asked, type=Launch)

    def on_settled(supervisor: Supervisor, failed: str) -> None:
        if not _say(Settled(failed)) or failed:
            supervisor.stop()
        elif launch.owned:
            # Not before: a process with threads cannot fork its nodes.
            threading.Thread(target=_end_with_owner, args=(supervisor,), daemon=True).start()

    try:
        with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
            up.run(launch, nowhere, on_settled)
    except QuadctlError as error:
        _say(Settled(error.message, error.code, error.hint))
        return error.exit_code
    return 0


def _end_with_owner(supervisor: Supervisor) -> None:
    os.read(0, 1)
    supervisor.stop()


def _say(settled: Settled) -> bool:
    """Whether who waits for it is still there to hear it."""
    try:
        os.write(1, msgspec.json.encode(settled))
    except BrokenPipeError:
        return False
    # Letting go of stdout tells the reader that this was all; stderr is the command's own, and
    # who captures it would wait for its end as long as we run.
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (2, 1):
        os.dup2(nowhere, stream)
    os.close(nowhere)
    return True


if __name__ == "__main__":
    sys.exit(main())
