"""A console that runs, and the addresses that it has printed."""

import json
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from tests.support.lab import Lab
from tests.support.running import Foreground, eventually


class Console(NamedTuple):
    """`control` and `watch` are the page's addresses."""

    process: Foreground
    control: str
    watch: str


@contextmanager
def served(lab: Lab, *words: str) -> Iterator[Console]:
    """`quadctl console` on a free port; ended by Ctrl-C, which must work at once."""
    process = lab.spawn(*lab.command("console", "--port", "0", "--json", *words))
    said = eventually(lambda: _said(process), 30.0)
    yield Console(process, said["url"], said["watch"])
    if not process.ended:
        process.send(signal.SIGINT)
    assert process.wait(30.0) == 130, process.log
    assert "Traceback" not in process.log, process.log


def _said(process: Foreground) -> dict[str, Any]:
    line = process.log.partition("\n")[0]
    assert not process.ended, process.log
    return json.loads(line) if line.endswith("}") else {}
