"""Process of the recorder; it reports its progress on stdout.

python -P -m quadctl.services.recorder -o FILE [--key KEY]... [--duration S] [--attended]
"""

import argparse
import contextlib
import logging
import math
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
from quadctl.services.runtime.bus.streams import RecorderSubscriber
from quadctl.services.runtime.entry import start
from quadctl.services.runtime.errors import QuadctlError, UsageError
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.process_table import RECORDER
from quadctl.services.runtime.realm import Realm


class Attendant:
    """Link to the command that reads our stdout; at its end the recorder completes its file."""

    def __init__(self, node: Node) -> None:
        self._node = node
        # A command that does not read its pipe must not block the recorder.
        os.set_blocking(1, False)
        threading.Thread(target=self._watch, daemon=True).start()

    def send(self, facts: dict[str, object]) -> None:
        """Print the facts; drop them if the command has ended or does not read, the last ones late."""
        until = time.monotonic() + (0.0 if facts["state"] == "recording" else _LAST_WORD)
        with contextlib.suppress(BrokenPipeError):
            while True:
                try:
                    os.write(1, msgspec.json.encode(facts) + b"\n")
                except BlockingIOError:
                    if time.monotonic() < until:
                        time.sleep(_PAUSE)
                        continue
                return

    def send_failure(self, problem: QuadctlError) -> None:
        """Print why the recording failed."""
        error = {"code": problem.code, "message": problem.message, "hint": problem.hint}
        self.send({"state": "failed", **error})

    def _watch(self) -> None:
        # The command holds the other end, which closes however the command ends.
        while os.read(0, 1 << 10):
            pass
        self._node.executor.stop()


_FLUSHES = 4.0
"""Hz at which chunks are written. A crash loses the last chunk: with all delays less than 0.5 s."""
_AT_ONCE, _PAUSE = 100, 0.001
"""Messages per batch, and the pause (s) after it in which the thread that receives gets the GIL."""
_HUB_WAIT = 5.0
_LAST_WORD = 5.0
"""Seconds for the last facts: the command may be suspended, and its pipe full. It kills us after 10."""
_EVERYTHING = ("**", "*/@call/**")
_DECLARED, _MOST = tuple(topic.key("*") for topic in TOPICS), 100 << 20
"""Keys and bytes of the recording of a guarded node, which would fill the disk."""

Send = Callable[[dict[str, object]], None]


def main() -> None:
    """Parse the options that only the recorder has, then run its node."""
    options, rest = _parser().parse_known_args()
    # The parameters of a realm on another machine are not known here.
    options.local = not any(word.startswith("--connect") for word in rest)
    sys.argv[1:] = rest
    if options.attended:
        # A command within a run inherits these, but only that run's own recorder is supervised.
        for name in ("QUADCTL_SUPERVISED", "QUADCTL_RESTARTS"):
            os.environ.pop(name, None)
    # A supervised run has one recorder of this name; others run beside it under their own names.
    alone = not os.environ.get("QUADCTL_SUPERVISED")
    name = f"{RECORDER}-{os.getpid()}" if alone else RECORDER
    start(name, partial(_attended, options), partial(_open, options), keeps_time=True)


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
    # Print the progress on stdout, one JSON document a line, and end when stdin closes.
    parser.add_argument("--attended", action="store_true")
    return parser


def _attended(options: argparse.Namespace, node: Node, params: Params) -> None:
    """Record; if attended, print progress and failures for the command that started us."""
    if not options.attended:
        run(options, node, params, lambda _facts: None)
        return
    node.log.setLevel(logging.WARNING)
    attendant = Attendant(node)
    try:
        run(options, node, params, attendant.send)
    except QuadctlError as problem:
        attendant.send_failure(problem)
        sys.exit(problem.exit_code)
    finally:
        _leave_nothing(options.realm, node)


def run(options: argparse.Namespace, node: Node, params: Params, send: Send) -> None:
    """Record until stopped; of several vehicles' nodes the first one records for all.

    `send` gets the progress about once a second, and at once when the hub is lost or back.
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
    if node.restarted:
        path = _next_free(path)
    little = bool(os.environ.get("QUADCTL_RECORD_LITTLE"))
    recording = Recording(path, notes, _MOST if little else math.inf)
    tap = node.tap(tuple(options.key) or (_DECLARED if little else _EVERYTHING))
    for topic in TOPICS:
        if topic.latched:
            tap.request_latched(f"*/{topic.name}")
    node.log.info("recording to %s", path)
    _record(node, recording, tap, send, time.monotonic() + options.duration)
    facts = recording.facts("done")
    node.log.info("recorded %d messages of %d keys to %s", facts["messages"], facts["keys"], path)
    send(facts)


def _record(
    node: Node, recording: Recording, tap: RecorderSubscriber, send: Send, end: float
) -> None:
    for count, now in enumerate(node.ticks(_FLUSHES)):
        left_out = recording.left_out
        _write(recording, tap)
        if recording.left_out > left_out == 0:
            node.log.warning(
                "messages of further keys are not recorded: the file has no room for more"
            )
        if tap.lost > recording.lost:
            node.log.warning("%d messages were lost: no room to buffer them", tap.lost)
        recording.lost = tap.lost
        before, recording.connected = recording.connected, tap.has_held()
        if count % _FLUSHES == 0 or recording.connected is not before:
            send(recording.facts("recording"))
        if now >= end:
            node.executor.stop()
    tap.settle()
    _write(recording, tap)
    recording.end()


def _write(recording: Recording, tap: RecorderSubscriber) -> None:
    """Write the messages that wait now, not later ones: the loop has other work, too."""
    left = tap.waiting
    while left > 0:
        found = (tap.next(0) for _ in range(min(left, _AT_ONCE)))
        recording.take([message for message in found if message is not None])
        left -= _AT_ONCE
        if left > 0:
            time.sleep(_PAUSE)
    recording.flush()


def _next_free(path: Path) -> Path:
    """Return an unused path beside the file of the recorder that died before this one."""
    number = 1
    while (free := path.with_stem(f"{path.stem}-{number}")).exists():
        number += 1
    return free


def _leave_nothing(realm: Realm, node: Node) -> None:
    """Remove our lock, as no other process will have our name, and the folder if it is empty."""
    (realm.folder / f"{node.vehicle}.{node.name}.lock").unlink(missing_ok=True)
    with contextlib.suppress(OSError):
        realm.folder.rmdir()


if __name__ == "__main__":
    main()
