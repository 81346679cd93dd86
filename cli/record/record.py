"""`record`: the recorder as a process, and its progress."""

import contextlib
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Self

import msgspec

from quadctl.cli import context, output
from quadctl.cli.context import LONGEST_TIMEOUT, Options, about_topic, anyone
from quadctl.cli.declarations import Arg, Option
from quadctl.cli.names import checked_key
from quadctl.services.runtime.errors import WIRE_ERRORS, Invalid, QuadctlError
from quadctl.services.runtime.files import taken

ENDING = ".mcap"


def default_file() -> Path:
    """As rosbag names its own: by the time of day, in the working directory."""
    return Path(time.strftime(f"quadctl_%Y-%m-%d_%H-%M-%S{ENDING}"))


def free(path: Path) -> None:
    """Raise Invalid where the file is there already: no recording is written over."""
    if path.exists():
        raise taken(path)


_PATIENCE = 10.0
"""Seconds that it may take to make its file whole."""


class Recorder:
    """Runs for as long as a `with` block lasts, and ends its file whole however that is left."""

    def __init__(
        self, options: Options, file: Path, keys: list[str], duration: float | None
    ) -> None:
        command = [sys.executable, "-P", "-m", "quadctl.services.recorder", "--attended"]
        command += ["--realm", options.realm, "--vehicle", options.vehicle, "-o", str(file)]
        command += ["--connect", options.connect] if options.connect else []
        command += [word for key in keys for word in ("--key", key)]
        command += ["--duration", repr(duration)] if duration is not None else []
        self._file = file
        # In a session of its own: Ctrl-C is this command's to hear, and to pass on. With our end of
        # its stdin it also ends when we are killed.
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )

        self._limit = threading.Timer(_PATIENCE, self._process.kill)
        self._limit.daemon = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._limit.cancel()
        assert self._process.stdin is not None  # noqa: S101 - a pipe, as asked for above
        self._process.stdin.close()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def reports(self) -> Iterator[dict[str, Any]]:
        """What it tells, until it has ended; raises why it ended where that was not asked for."""
        assert self._process.stdout is not None  # noqa: S101 - a pipe, as asked for above
        for line in self._process.stdout:
            facts = msgspec.json.decode(line)
            if facts["state"] == "failed":
                self._process.wait(_PATIENCE)
                kind = WIRE_ERRORS.get(facts["code"], QuadctlError)
                raise kind(facts["message"], facts["hint"])
            yield facts
            if facts["state"] == "done":
                return
        code = self._process.wait(_PATIENCE)
        hint = "its lines above say why"
        if self._file.exists():
            hint = f"`quadctl bag repair {self._file}` makes what there is of it whole"
        raise QuadctlError(f"the recorder ended before its file was whole (exit {code})", hint)

    def stop(self) -> None:
        """Ask it to make its file whole, and to end."""
        with contextlib.suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGTERM if sys.platform == "win32" else signal.SIGINT)
        self._limit.start()


def record(
    options: Options,
    keys: Annotated[
        list[str] | None,
        Arg("Topics, Zenoh keys or expressions (default: everything).", complete="topic"),
    ] = None,
    file: Annotated[
        Path | None, Option("Where to (default: quadctl_DATE_TIME.mcap).", ("-o", "--output"))
    ] = None,
    duration: Annotated[
        float | None, Option("End after so many seconds.", ("-d", "--duration"))
    ] = None,
) -> None:
    """Record what is said on the bus, until Ctrl-C: exit 0, and the file is whole.

    The file is MCAP, which Foxglove, Lichtblick and PlotJuggler open. The recorder is a process of
    its own, and ends with this command, however that ends.

    Example: quadctl record -o flight.mcap
    """
    if duration is not None and not 0 < duration <= LONGEST_TIMEOUT:
        raise Invalid(f"--duration {duration:g}: not a time", "give seconds, more than 0")
    wanted = [checked_key(key, about_topic(options, key).vehicle) for key in keys or ()]
    options = anyone(options)
    path = file or default_file()
    free(path)
    from quadctl.services.runtime.security import permissions

    with context.connect(options) as client:
        # Whether there is anything to record is known here, and said better.
        client.flush()
        wanted = wanted or permissions.everything(options.connect)
        client.permit("listen", *wanted)
    with Recorder(options, path, wanted, duration) as recorder:
        facts = _follow(options, recorder)
    if not options.json:
        output.line(_summary(facts))


def _follow(options: Options, recorder: Recorder) -> dict[str, Any]:
    """Show how far it is until it has ended; the first Ctrl-C ends it well."""
    stopped, connected = False, True
    reports = recorder.reports()
    while True:
        try:
            for number, facts in enumerate(reports):
                _show(options, facts, first=number == 0 and not stopped)
                if facts["connected"] is not connected and not options.json:
                    _tell_of_the_hub(back=not connected)
                connected = facts["connected"]
                if facts["state"] == "done":
                    return facts
        except KeyboardInterrupt:
            if stopped:
                output.note("stopped waiting: the recorder ends by itself")
                raise
            stopped = True
            recorder.stop()
            reports = recorder.reports()


def _show(options: Options, facts: dict[str, Any], *, first: bool) -> None:
    if options.json:
        output.document(facts)
    elif first and facts["state"] == "recording":
        output.line(f"recording to {facts['file']}; Ctrl-C ends it")
    if not options.json and sys.stderr.isatty():
        text = f"{facts['seconds']:.0f} s, {facts['messages']} messages, {_size(facts['bytes'])}"
        sys.stderr.write(f"\r\033[K{text if facts['state'] == 'recording' else ''}")
        sys.stderr.flush()


def _tell_of_the_hub(*, back: bool) -> None:
    """In the place of the live line, which comes again below."""
    start = "\r\033[K" if sys.stderr.isatty() else ""
    text = "the hub is back" if back else "the hub is gone: recording goes on when it is back"
    output.note(f"{start}{text}")


def _summary(facts: dict[str, Any]) -> str:
    lost = f", {facts['lost']} lost" if facts["lost"] else ""
    return (
        f"{facts['file']}: {facts['messages']} messages of {facts['keys']} keys in"
        f" {facts['seconds']:.1f} s, {_size(facts['bytes'])}{lost}"
    )


def _size(count: int) -> str:
    return f"{count / 1e6:.2f} MB"
