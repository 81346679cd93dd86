"""Running console, and the addresses that it prints."""

import json
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from tests.support.lab import Lab
from tests.support.running import Foreground, eventually


class Console(NamedTuple):
    """Console process; `control` and `watch` are the page's addresses."""

    process: Foreground
    control: str
    watch: str


@contextmanager
def served(lab: Lab, *words: str) -> Iterator[Console]:
    """Run `quadctl console` on a free port; unless the block has ended it, Ctrl-C must."""
    process = lab.spawn(*lab.command("console", "--port", "0", "--json", *words))
    printed = eventually(lambda: _printed(process))
    try:
        yield Console(process, printed["url"], printed["watch"])
    except BaseException as failure:
        failure.add_note(f"the console, ended: {process.ended}, printed {process.log}")
        process.end()
        raise
    if not process.ended:
        process.send(signal.SIGINT)
        assert process.wait() == 130, process.log
    assert "Traceback" not in process.log, process.log


def _printed(process: Foreground) -> dict[str, Any]:
    line = process.log.partition("\n")[0]
    assert not process.ended, process.log
    return json.loads(line) if line.endswith("}") else {}
