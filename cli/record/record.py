"""`record`: what is said on the bus, into a file."""

import sys
from pathlib import Path
from typing import Annotated, Any

from cli import bus, output
from cli.declare import Arg, Opt
from cli.names import checked_key
from cli.options import LONGEST_TIMEOUT, Options
from cli.record.files import default_file, free
from cli.record.recorder import Recorder
from cli.which import about_topic, anyone
from services.runtime.errors import Invalid


def record(
    options: Options,
    keys: Annotated[
        list[str] | None,
        Arg("Topics, Zenoh keys or expressions (default: everything).", complete="topic"),
    ] = None,
    file: Annotated[
        Path | None, Opt("Where to (default: quadctl_DATE_TIME.mcap).", ("-o", "--output"))
    ] = None,
    duration: Annotated[
        float | None, Opt("End after so many seconds.", ("-d", "--duration"))
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
    from services.runtime.security import permissions

    with bus.connect(options) as client:
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
