"""`fly`: a mission at simulated times, and the digests of the flight."""

import time
from pathlib import Path
from typing import Annotated, Any

import msgspec

from cli import bus, output
from cli.declare import Arg
from cli.fly.flight import Flight
from cli.fly.mission import mission
from cli.lab.progress import Progress
from cli.options import Options
from schemas.services import CalibrateResponse, GotoResponse
from services.runtime.bus.scheduled_calls import Ahead
from services.runtime.params.load import read


def fly(
    options: Options, mission_file: Annotated[Path, Arg("A mission, TOML.", "MISSION")]
) -> None:
    """Fly a mission from the vehicle's start, each row at its simulated time.

    Prints the SHA-256 of every pose, of safety's transitions and of the barometer's readings: the
    same for every flight of the mission with these parameters, whatever the speed and the load.

    Example: quadctl fly examples/mission.toml
    """
    plan = mission(read(mission_file), str(mission_file))
    with bus.connect(options) as client:
        flight = Flight(client, plan)
        began = time.monotonic()
        try:
            with Progress("flying", quiet=options.json) as progress:
                flight.fly(lambda at: progress.update(at / plan.end, f"{at:.1f} s"))
        except KeyboardInterrupt:
            output.note("the mission is dropped: the vehicle is back at its start")
            raise
        wall = time.monotonic() - began
    digests = flight.record.document()
    rows = [msgspec.to_builtins(row) | _outcome(call) for row, call in flight.rows]
    if options.json:
        output.document(
            digests
            | {
                "rows": rows,
                "simulated_seconds": plan.end,
                "wall_seconds": wall,
                "speed": flight.parameters["dynamics.speed"],
                "seed": flight.parameters["dynamics.seed"],
            }
        )
        return
    output.table(
        (f"{row.at:.2f} s", row, _told(said))
        for (row, _), said in zip(flight.rows, rows, strict=True)
    )
    output.line(f"{plan.end:g} s of flight in {wall:.1f} s; SHA-256 of the logs:")
    counts = digests["counts"]
    output.table((name, digests[name], f"of {counts[name]}") for name in counts)
    output.line(f"all three  {digests['hash']}")


def _outcome(call: Ahead[Any, Any]) -> dict[str, Any]:
    """Whether a row was done, and why not."""
    if call.problem is not None:
        return {"accepted": False, "reason": call.problem.message, "code": call.problem.code}
    if isinstance(call.reply, GotoResponse):
        return {"accepted": call.reply.accepted, "reason": call.reply.reason}
    more = {"baseline": call.reply.baseline} if isinstance(call.reply, CalibrateResponse) else {}
    return {"accepted": True, "reason": ""} | more


def _told(said: dict[str, Any]) -> str:
    if not said["accepted"]:
        return f"rejected: {said['reason']}"
    return f"baseline {said['baseline']:.4f} hPa" if "baseline" in said else "accepted"
