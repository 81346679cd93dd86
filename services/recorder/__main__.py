"""The recorder's process: all that is said on the bus, into a file.

python -P -m services.recorder -o FILE [--key KEY]... [--duration S] [--attended]
"""

import argparse
import contextlib
import logging
import os
import sys
import threading
import time
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec

from schemas.params import Params
from schemas.topics import TOPICS
from services.recorder.process.recording import Recording
from services.runtime import session
from services.runtime.entry import start
from services.runtime.errors import QuadctlError, UsageError
from services.runtime.node import Node
from services.runtime.processes import RECORDER
from services.runtime.realm import Realm
from services.runtime.tap import Tap

_FLUSHES = 4.0
"""Chunks a second: what is not in a whole chunk is lost with the process. A quarter of a second,
so that with all delays it is less than half of one."""
_AT_ONCE, _PAUSE = 100, 0.001
"""Messages that are written at a stretch, and how long (s) what comes meanwhile is then given: the
thread that reads needs the interpreter for each message."""
_HUB_WAIT = 5.0
_EVERYTHING = ("**", "*/@call/**")


def main() -> None:
    """Read the words that no other node has, and be a node."""
    options, rest = _parser().parse_known_args()
    # Of a realm elsewhere nothing is known but what is said on its bus.
    options.local = not any(word.startswith("--connect") for word in rest)
    sys.argv[1:] = rest
    supervised = bool(os.environ.get("QUADCTL_SUPERVISED"))
    # A run has one recorder; whoever wants another may have it beside.
    name = RECORDER if supervised else f"{RECORDER}-{os.getpid()}"
    start(name, partial(_attended, options), _open)


def _open(address: session.Address, _params: Params, _realm: Realm) -> Any:
    return session.open_client(address, wait=_HUB_WAIT, threads=session.TWO_THREADS)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("-o", "--output", type=Path, default=os.environ.get("QUADCTL_RECORD"))
    parser.add_argument("--key", action="append", default=[])
    parser.add_argument("--duration", type=float, default=float("inf"))
    # Tells how far it is on stdout, one JSON document a line, and ends when stdin does.
    parser.add_argument("--attended", action="store_true")
    return parser


def _attended(options: argparse.Namespace, node: Node, params: Params) -> None:
    """Run, and tell whoever has started it how it went."""
    if not options.attended:
        run(options, node, params)
        return
    node.log.setLevel(logging.WARNING)
    # Who does not read what is told must not keep the recorder waiting.
    os.set_blocking(1, False)
    threading.Thread(target=_watch, args=(node,), daemon=True).start()
    try:
        run(options, node, params)
    except QuadctlError as problem:
        _tell({"state": "failed", "message": problem.message, "hint": problem.hint})
        sys.exit(problem.exit_code)


def run(options: argparse.Namespace, node: Node, params: Params) -> None:
    """Record until stopped; of several vehicles' nodes the first one does, for all."""
    if not node.first:
        node.spin()
        return
    if not options.output:
        raise UsageError("there is no file to record to", "name one: -o FILE")
    path = Path(options.output)
    notes = _notes(node)
    if options.local:
        notes["params"] = msgspec.json.encode(params).decode()
    recording = Recording(_next_free(path) if node.restarted else path, notes)
    tap = node.tap(tuple(options.key) or _EVERYTHING)
    for topic in TOPICS:
        if topic.latched:
            tap.ask(f"*/{topic.name}")
    node.log.info("recording to %s", recording.path)
    _record(options, node, recording, tap)
    facts = recording.facts("done")
    node.log.info(
        "recorded %d messages of %d keys to %s", facts["messages"], facts["keys"], recording.path
    )
    if options.attended:
        _tell(facts)


def _record(options: argparse.Namespace, node: Node, recording: Recording, tap: Tap) -> None:
    end = time.monotonic() + options.duration
    for count, now in enumerate(node.ticks(_FLUSHES)):
        _write(recording, tap)
        if tap.lost > recording.lost:
            node.log.warning("%d messages came that there was no room for", tap.lost)
        recording.lost = tap.lost
        if options.attended and count % _FLUSHES == 0:
            _tell(recording.facts("recording"))
        if now >= end:
            node.loop.stop()
    tap.settle()
    _write(recording, tap)
    recording.end()


def _write(recording: Recording, tap: Tap) -> None:
    """Write what waits now, and no more than that: others want something, too."""
    left = tap.waiting
    while left > 0:
        recording.take(tap.take(min(left, _AT_ONCE)))
        left -= _AT_ONCE
        if left > 0:
            time.sleep(_PAUSE)
    recording.flush()


def _notes(node: Node) -> dict[str, str]:
    return {
        "quadctl": version("quadctl"),
        "vehicle": node.vehicle,
        "began": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
    }


def _next_free(path: Path) -> Path:
    """Beside what was recorded before this process took a dead one's place."""
    number = 1
    while (free := path.with_stem(f"{path.stem}-{number}")).exists():
        number += 1
    return free


def _watch(node: Node) -> None:
    # Who has started us holds the other end: we end, with a whole file, however that one does.
    while os.read(0, 1 << 10):
        pass
    node.loop.stop()


def _tell(facts: dict[str, object]) -> None:
    # The reader may be gone, or frozen: the recording is whole all the same.
    with contextlib.suppress(BrokenPipeError, BlockingIOError):
        os.write(1, msgspec.json.encode(facts) + b"\n")


if __name__ == "__main__":
    main()
