"""Runner of one command like its console script, with the seconds of each stage.

`stages.py CLOCK STARTED MODULE:FUNCTION WORD...`, run as a script: CLOCK is a function of `time`,
monotonic or process_time, STARTED the time (s) of its start by that clock. The last line on stderr
is JSON: seconds by stage, and the time of its exit.
"""

import sys
import time

clock = getattr(time, sys.argv[1])
_BEGAN = clock()

import builtins  # noqa: E402 - the clock comes first
import json  # noqa: E402
import os  # noqa: E402
from collections.abc import Callable  # noqa: E402
from typing import Any, NoReturn  # noqa: E402

_PACKAGES = ("msgspec", "zenoh")
_REST = "import our own, and dependencies"


class Imports:
    """Times of imports for msgspec, zenoh and the rest, each without the others."""

    def __init__(self) -> None:
        self.took = dict.fromkeys([*(f"import {name}" for name in _PACKAGES), _REST], 0.0)
        self._import = builtins.__import__
        self._open: list[str] = []
        self._since = 0.0
        builtins.__import__ = self

    def __call__(self, name: str, *rest: Any, **more: Any) -> Any:
        """Import a module and add its time to the package that imports it."""
        root = name.partition(".")[0]
        here = f"import {root}" if root in _PACKAGES else (self._open or [_REST])[-1]
        self._book()
        self._open.append(here)
        try:
            return self._import(name, *rest, **more)
        finally:
            self._book()
            self._open.pop()

    @property
    def total(self) -> float:
        """Return the sum of all times (s)."""
        return sum(self.took.values())

    def _book(self) -> None:
        now = clock()
        if self._open:
            self.took[self._open[-1]] += now - self._since
        self._since = now


def main(started: float, entry: str, words: list[str]) -> None:
    """Run the command, which ends the process itself."""
    imports, marks = Imports(), {}

    def marked(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*arguments: Any, **more: Any) -> Any:
            marks[f"{name} began"] = clock() - imports.total
            try:
                return function(*arguments, **more)
            finally:
                marks[f"{name} ended"] = clock() - imports.total

        return wrapped

    def leave(code: int) -> NoReturn:
        left = clock()
        worked = left - imports.total
        opened, done = marks.get("open began", worked), marks.get("open ended", worked)
        stages = {
            "python starts": _BEGAN - started,
            **imports.took,
            "command line": opened - _BEGAN,
            "open": done - opened,
            "call, print, close": worked - done,
        }
        sys.stderr.write(json.dumps({"stages": stages, "left": left}) + "\n")
        sys.stderr.flush()
        plain_exit(code)

    plain_exit, os._exit = os._exit, leave
    import zenoh

    zenoh.open = marked("open", zenoh.open)
    module, _, function = entry.partition(":")
    sys.argv[:] = ["quadctl", *words]
    getattr(__import__(module, fromlist=[function]), function)()
    leave(0)


if __name__ == "__main__":
    main(float(sys.argv[2]), sys.argv[3], sys.argv[4:])
