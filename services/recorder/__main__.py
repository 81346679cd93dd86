"""Process of the recorder, with its progress on stdout.

python -P -m quadctl.services.recorder -o FILE [--key KEY]... [--duration S] [--attended]
"""

import argparse
import contextlib
import logging
import os
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec

from quadctl.schemas.params import Params
from quadctl.schemas.topics import TOPICS
from quadctl.services.recorder.recording import Recording
from quadctl.services.runtime.bus import session
from quadctl.services.runtime.bus.raw import RecorderSubscriber
from quadctl.services.runtime.entry import start
from quadctl.services.runtime.errors import QuadctlError, UsageError
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.process_table import RECORDER
from quadctl.services.runtime.realm import Realm


class Attendant:
    """Reads one JSON document a line; the recorder ends, with a whole file, when its stdin does."""

    def __init__(self, node: Node) -> None:
        self._node = node
        # Who does not read what is told must not keep the recorder waiting.
        os.set_blocking(1, False)
        threading.Thread(target=self._watch, daemon=True).start()

    def tell(self, facts: dict[str, object]) -> None:
        """Say how far it is; who is gone, or frozen, is not told."""
        with contextlib.suppress(BrokenPipeError, BlockingIOError):
            os.write(1, msgspec.json.encode(facts) + b"\n")

    def tell_failure(self, problem: QuadctlError) -> None:
        """Say why it has ended."""
        said = {"code": problem.code, "message": problem.message, "hint": problem.hint}
        self.tell({"state": "failed", **said})

    def _watch(self) -> None:
        # The attendant holds the other end: it is closed however that one ends.
        while os.read(0, 1 << 10):
            pass
        self._node.executor.stop()


_FLUSHES = 4.0
"""Chunks a second: what is not in a whole chunk is lost with the process. A quarter of a second,
so that with all delays it is less than half of one."""
_AT_ONCE, _PAUSE = 100, 0.001
"""Messages that are written at a stretch, and how long (s) what comes meanwhile is then given: the
thread that reads needs the interpreter for each message."""
_HUB_WAIT = 5.0
_EVERYTHING = ("**", "*/@call/**")

Tell = Callable[[dict[str, object]], None]


def main() -> None:
    """Read the words that no other node has, and be a node."""
    options, rest = _parser().parse_known_args()
    # Of a realm elsewhere nothing is known but what is said on its bus.
    options.local = not any(word.startswith("--connect") for word in rest)
    sys.argv[1:] = rest
    if options.attended:
        # What a run's supervisor says to its own is not for the recorder of a command in that run.
        for name in ("QUADCTL_SUPERVISED", "QUADCTL_RESTARTS"):
            os.environ.pop(name, None)
    # A run has one recorder; whoever wants another may have it beside.
    alone = not os.environ.get("QUADCTL_SUPERVISED")
    name = f"{RECORDER}-{os.getpid()}" if alone else RECORDER
    start(name, partial(_attended, options), partial(_open, options))


def _open(
    options: argparse.Namespace, address: session.Address, _params: Params, realm: Realm
) -> Any:
    options.realm = realm
    return session.open_client(address, wait=_HUB_WAIT, threads=session.TWO_THREADS)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument(
        "-o", "--output", type=Path, default=os.environ.get("QUADCTL_RECORD") or None
    )
    parser.add_argument("--key", action="append", default=[])
    parser.add_argument("--duration", type=float, default=float("inf"))
    # Tells how far it is on stdout, one JSON document a line, and ends when stdin does.
    parser.add_argument("--attended", action="store_true")
    return parser


def _attended(options: argparse.Namespace, node: Node, params: Params) -> None:
    """Run, and tell whoever has started it how it went."""
    if not options.attended:
        run(options, node, params, lambda _facts: None)
        return
    node.log.setLevel(logging.WARNING)
    attendant = Attendant(node)
    try:
        run(options, node, params, attendant.tell)
    except QuadctlError as problem:
        attendant.tell_failure(problem)
        sys.exit(problem.exit_code)
    finally:
        _leave_nothing(options.realm, node)


def run(options: argparse.Namespace, node: Node, params: Params, tell: Tell) -> None:
    """Record until stopped; `tell` about once a second how far it is, of the hub's loss at once.

    Of several vehicles' nodes the first one records, for all.
    """
    if not node.is_first:
        node.spin()
        return
    if not options.output:
        raise UsageError("there is no file to record to", "name one: -o FILE")
    path = Path(options.output)
    notes = {
        "quadctl": version("quadctl"),
        "vehicle": node.vehicle,
        "began": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
    }
    if options.local:
        notes["params"] = msgspec.json.encode(params).decode()
    recording = Recording(_next_free(path) if node.restarted else path, notes)
    tap = node.tap(tuple(options.key) or _EVERYTHING)
    for topic in TOPICS:
        if topic.latched:
            tap.ask(f"*/{topic.name}")
    node.log.info("recording to %s", recording.path)
    _record(node, recording, tap, tell, time.monotonic() + options.duration)
    facts = recording.facts("done")
    node.log.info(
        "recorded %d messages of %d keys to %s", facts["messages"], facts["keys"], recording.path
    )
    tell(facts)


def _record(
    node: Node, recording: Recording, tap: RecorderSubscriber, tell: Tell, end: float
) -> None:
    for count, now in enumerate(node.ticks(_FLUSHES)):
        _write(recording, tap)
        if tap.lost > recording.lost:
            node.log.warning("%d messages came that there was no room for", tap.lost)
        recording.lost = tap.lost
        before, recording.connected = recording.connected, tap.has_held()
        if count % _FLUSHES == 0 or recording.connected is not before:
            tell(recording.facts("recording"))
        if now >= end:
            node.executor.stop()
    tap.settle()
    _write(recording, tap)
    recording.end()


def _write(recording: Recording, tap: RecorderSubscriber) -> None:
    """Write what waits now, and no more than that: others want something, too."""
    left = tap.waiting
    while left > 0:
        recording.take(tap.take(min(left, _AT_ONCE)))
        left -= _AT_ONCE
        if left > 0:
            time.sleep(_PAUSE)
    recording.flush()


def _next_free(path: Path) -> Path:
    """Beside what was recorded before this process took a dead one's place."""
    number = 1
    while (free := path.with_stem(f"{path.stem}-{number}")).exists():
        number += 1
    return free


def _leave_nothing(realm: Realm, node: Node) -> None:
    """Our name will not be another's: its lock goes, and a folder that was made for it alone."""
    (realm.folder / f"{node.vehicle}.{node.name}.lock").unlink(missing_ok=True)
    with contextlib.suppress(OSError):
        realm.folder.rmdir()


if __name__ == "__main__":
    main()
