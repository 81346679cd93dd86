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
from quadctl.cli.context import LONGEST_TIMEOUT, Options, about_topic, with_any_vehicle
from quadctl.cli.declarations import Arg, Option
from quadctl.cli.names import checked_key
from quadctl.services.runtime.errors import WIRE_ERRORS, Invalid, QuadctlError
from quadctl.services.runtime.files import already_exists, making
from quadctl.services.runtime.shutdown import uninterrupted

ENDING = ".mcap"


def default_file() -> Path:
    """Return a file in the working directory, named by date and time as rosbag does."""
    return Path(time.strftime(f"quadctl_%Y-%m-%d_%H-%M-%S{ENDING}"))


def free(path: Path) -> None:
    """Raise Invalid if the file exists, as no recording is overwritten, or has no folder."""
    if path.exists():
        raise already_exists(path)
    with making(path):
        path.parent.stat()


_PATIENCE = 10.0  # s for the recorder to complete its file
_CTRL_C = 128 + signal.SIGINT


class Recorder:
    """Recorder process of a `with` block; its file is complete however the block ends."""

    def __init__(
        self, options: Options, file: Path, keys: list[str], duration: float | None
    ) -> None:
        command = [sys.executable, "-P", "-m", "quadctl.services.recorder", "--attended"]
        command += ["--realm", options.realm, "--vehicle", options.vehicle, f"--output={file}"]
        command += ["--connect", options.connect] if options.connect else []
        command += [word for key in keys for word in ("--key", key)]
        command += ["--duration", repr(duration)] if duration is not None else []
        self._file = file
        self._last: dict[str, Any] = {"file": str(file), "lost": 0, "connected": True}
        # A separate session: Ctrl-C reaches only this command, which passes it on. When this
        # process is killed, its end of stdin closes and the recorder ends too.
        # Until its handler is there it takes no Ctrl-C, which would end its imports.
        with uninterrupted():
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
            )
        self._limit = threading.Timer(_PATIENCE, self._process.kill)
        self._limit.daemon = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._limit.cancel()
        assert self._process.stdin is not None  # noqa: S101 - a pipe, requested above
        self._process.stdin.close()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def reports(self) -> Iterator[dict[str, Any]]:
        """Yield its reports until it ends; raise the reason if it ended by itself."""
        assert self._process.stdout is not None  # noqa: S101 - a pipe, requested above
        for line in self._process.stdout:
            facts = msgspec.json.decode(line)
            if facts["state"] == "failed":
                self._process.wait(_PATIENCE)
                kind = WIRE_ERRORS.get(facts["code"], QuadctlError)
                raise kind(facts["message"], facts["hint"])
            self._last = facts
            yield facts
            if facts["state"] == "done":
                return
        code = self._process.wait(_PATIENCE)
        if code == _CTRL_C:  # that came before it had begun
            sys.exit(code)
        if code == 0:  # nobody read its last report: we were suspended, or a Ctrl-C came with it
            yield self._last | self._written()
            return
        hint = "see its lines above"
        if self._file.exists():
            hint = f"`quadctl bag repair {self._file}` recovers what it has recorded"
        raise QuadctlError(f"the recorder ended before its file was complete (exit {code})", hint)

    def _written(self) -> dict[str, Any]:
        """Return the part of the last report that the complete file has."""
        from quadctl.services.runtime.recording import reader

        found = reader.facts(self._file)
        return {
            "state": "done",
            "seconds": found.seconds,
            "messages": found.messages,
            "keys": len({key.key for key in found.keys if not key.derived}),
            "bytes": found.bytes,
        }

    def stop(self) -> None:
        """Signal it to complete its file and end; kill it after _PATIENCE."""
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
        Path | None, Option("Output file (default: quadctl_DATE_TIME.mcap).", ("-o", "--output"))
    ] = None,
    duration: Annotated[
        float | None, Option("End after this many seconds.", ("-d", "--duration"))
    ] = None,
) -> None:
    """Record messages from the bus until Ctrl-C, which ends with exit 0 and a complete file.

    The file is MCAP, which Foxglove, Lichtblick and PlotJuggler open. The recorder is a separate
    process, which ends with this command, however the command ends.

    Example: quadctl record -o flight.mcap
    """
    if duration is not None and not 0 < duration <= LONGEST_TIMEOUT:
        raise Invalid(f"--duration {duration:g}: not a time", "give seconds, more than 0")
    wanted = [checked_key(key, about_topic(options, key).vehicle) for key in keys or ()]
    options = with_any_vehicle(options)
    path = file or default_file()
    free(path)
    from quadctl.services.runtime.security import permissions

    with context.connect(options) as client:
        # Fail here, with a better message than the recorder's, without a hub or permission.
        client.flush()
        wanted = wanted or permissions.everything(options.connect)
        client.permit("listen", *wanted)
    with Recorder(options, path, wanted, duration) as recorder:
        facts = _follow(options, recorder)
    if not options.json:
        lost = f", {facts['lost']} lost" if facts["lost"] else ""
        output.line(
            f"{facts['file']}: {facts['messages']} messages of {facts['keys']} keys in"
            f" {facts['seconds']:.1f} s, {_size(facts['bytes'])}{lost}"
        )


def _follow(options: Options, recorder: Recorder) -> dict[str, Any]:
    """Show the progress until the recorder ends; the first Ctrl-C lets it complete the file."""
    stopped, connected = False, True
    reports = recorder.reports()
    while True:
        try:
            for number, facts in enumerate(reports):
                _show(options, facts, first=number == 0 and not stopped)
                if facts["connected"] is not connected and not options.json:
                    _note_hub(back=not connected)
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


def _note_hub(*, back: bool) -> None:
    """Print over the live line, which the next report prints again below."""
    start = "\r\033[K" if sys.stderr.isatty() else ""
    text = "the hub is back" if back else "the hub is gone: recording goes on when it is back"
    output.note(f"{start}{text}")


def _size(count: int) -> str:
    return f"{count / 1e6:.2f} MB"
