"""Outlives a supervisor that was killed, for as long as it takes to kill what its commands left.

A command's first process dies with the supervisor by its leash; what that one has started would
not. Runs only beside a user's commands, and only on Linux, where they can be found.
"""

import os

from services.runtime.run.forked import Forked
from services.runtime.run.sweep import MARK, sweep_away

_LEASH = f"{MARK}_WATCHED"


def watch(leash: str) -> Forked:
    """Start a warden; it acts when our end of its stdin closes, however that comes."""
    return Forked("services.runtime.run.warden", {_LEASH: leash}, "/", both=True)


def main() -> None:
    """Wait for the supervisor's end."""
    while os.read(0, 1):
        pass
    sweep_away(os.environ[_LEASH])


if __name__ == "__main__":
    main()
