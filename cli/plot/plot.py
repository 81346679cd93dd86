"""`plot`: a picture of a recorded flight or of a live one."""

import time
from pathlib import Path
from typing import Annotated

from quadctl.cli import context, output
from quadctl.cli.context import LONGEST_TIMEOUT, Options
from quadctl.cli.declarations import Arg, Option
from quadctl.cli.plot.track import RecordedFlight, drawn, is_drawn
from quadctl.cli.progress import Progress
from quadctl.schemas.topics import POSE
from quadctl.services.runtime.errors import Invalid, UsageError
from quadctl.services.runtime.files import refuse_existing


def plot(
    options: Options,
    file: Annotated[Path | None, Arg("A recording, MCAP.", "FILE")] = None,
    live: Annotated[
        bool, Option("Draw the flight from now on, until Ctrl-C or --duration.")
    ] = False,
    picture: Annotated[
        Path | None, Option("PNG or SVG (default: FILE.png, or live.png).", ("-o", "--output"))
    ] = None,
    duration: Annotated[
        float, Option("Seconds to draw of a live flight.", ("-d", "--duration"))
    ] = 10.0,
    force: Annotated[bool, Option("Overwrite a picture that is there.")] = False,
) -> None:
    """Draw a flight: path in the cage from above and the side, height, pressure, safety's states.

    Example: quadctl plot flight.mcap -o flight.png
    """
    if live is (file is not None):
        raise UsageError("plot draws a recording or a live flight", "give either FILE or --live")
    if not 0 < duration <= LONGEST_TIMEOUT:
        raise Invalid(f"--duration {duration:g}: not a time", "give seconds, more than 0")
    from quadctl.cli.plot.figure import draw

    target = picture or (file.with_suffix(".png") if file else Path("live.png"))
    refuse_existing(target, force=force)
    if file and file.exists() and target.exists() and target.samefile(file):
        raise Invalid(f"{target} is the recording itself", "name another picture: -o FILE")
    flight = recorded(file) if file else _live(options, duration)
    draw(target, flight, file.name if file else f"realm {options.realm}, live")
    flown = flight.flown()
    # The flight may have begun long before the recording.
    began = min(track.path[0][0] for track in flown.values())
    document = {
        "file": str(target),
        "vehicles": list(flown),
        "poses": sum(leg.added for track in flown.values() for leg in track.legs),
        "seconds": max(track.end for track in flown.values()) - began,
    }
    output.either(options, document, f"drew {document['seconds']:.1f} s of flight: {target}")


def recorded(file: Path) -> RecordedFlight:
    """Return the flight in a recording, with a note if it is cut or damaged."""
    from quadctl.services.runtime.recording.reader import Bag

    flight, bag = RecordedFlight(), Bag(file)
    for message in bag.messages(lambda channel: is_drawn(channel.topic)):
        flight.add(message.key, message.decoded)
    if bag.problem:
        output.note(f"the recording is {bag.problem}")
    return flight


def _live(options: Options, duration: float) -> RecordedFlight:
    flight = RecordedFlight()
    with context.connect(options) as client, Progress("listening", quiet=options.json) as progress:
        stream = client.listen(*drawn("*"), backlog=1_000_000)
        began = received = time.monotonic()
        try:
            if not options.json:
                output.note(f"listening for {duration:g} s; Ctrl-C ends it sooner")
            while (now := time.monotonic()) < began + duration:
                # Poses always come while a vehicle is up; without them there is no picture.
                message = stream.next(min(began + duration - now, client.timeout))
                if message is not None:
                    received = time.monotonic()
                    flight.add(message.key, message.decoded)
                    progress.update((now - began) / duration, f"{now - began:.1f} s")
                elif time.monotonic() - received >= client.timeout:
                    break
        except KeyboardInterrupt:
            output.note("stopped listening: drawing what has arrived")
        if not flight.flown():
            raise client.silent(POSE.key(client.vehicle))
    return flight
