"""`demo`: the whole lab on a realm of its own, checkpoint by checkpoint."""

import os
from pathlib import Path
from typing import Annotated, Any

from quadctl.cli import output
from quadctl.cli.context import Options, here
from quadctl.cli.declarations import Option
from quadctl.cli.demo.checkpoints import CHECKPOINTS, Lab
from quadctl.cli.temporary_run import run_of_its_own
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.params.catalogue import lab_params
from quadctl.services.runtime.realm import DEFAULT
from quadctl.services.runtime.supervisor.launch import Launch


def demo(
    options: Options,
    picture: Annotated[
        Path, Option("Where to write the picture of the flight, PNG or SVG.")
    ] = Path("demo.png"),
) -> None:
    """Fly the lab's four checkpoints, show the evidence, and draw the flight.

    Example: quadctl demo --picture flight.svg
    """
    here(options, "demo")
    from quadctl.cli.plot.figure import draw
    from quadctl.cli.plot.track import RecordedFlight, wanted

    params = lab_params()
    vehicle = options.named or DEFAULT
    launch = Launch(f"demo-{os.getpid()}", {vehicle: params}, [], str(Path.cwd()))
    with (
        run_of_its_own(launch) as realm,
        Client(launch.realm, vehicle, timeout=options.timeout) as client,
    ):
        heard = client.listen(*wanted([client.vehicle]), backlog=100_000)
        lab = Lab(client, params, realm.logs / "safety.log")
        report = [
            _fly(number, title, list(checkpoint(lab)), quiet=options.json)
            for number, (title, checkpoint) in enumerate(CHECKPOINTS, start=1)
        ]
        flight = RecordedFlight()
        while (message := heard.next(0)) is not None:
            flight.add(message.key, message.payload, message.encoding)
        draw(picture, flight, "quadctl demo: the lab's four checkpoints, flown")
    holds = all(checkpoint["holds"] for checkpoint in report)
    if options.json:
        output.document({"ok": holds, "checkpoints": report, "picture": str(picture)})
    else:
        output.line(f"picture of the flight: {picture}")
        output.line("all checkpoints hold" if holds else "some checkpoints do not hold")
    output.end(ok=holds)


def _fly(number: int, title: str, evidence: list[Any], *, quiet: bool) -> dict[str, Any]:
    holds = all(item.holds for item in evidence)
    if not quiet:
        output.line(f"Checkpoint {number}: {title}: {'holds' if holds else 'FAILS'}")
        for item in evidence:
            output.line(f"  {'ok  ' if item.holds else 'FAIL'}  {item.text}")
    texts = [{"holds": item.holds, "text": item.text} for item in evidence]
    return {"name": title, "holds": holds, "evidence": texts}
