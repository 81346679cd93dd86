"""Asking one node for its parameters, which every node answers whose loop turns."""

from typing import Any

from cli.node.seen import Seen
from schemas.services import GetParamsRequest
from schemas.topics import get_params
from services.runtime.bus.client import Client
from services.runtime.errors import TimedOut, Unreachable
from services.runtime.process_table import NODES
from services.runtime.procfs import has_ended
from services.runtime.run_files import ProcessRecord


def answering(seen: Seen) -> list[ProcessRecord]:
    """Who says that it answers, and our own that do not say so because they are away."""
    away = set(NODES) - set(seen.live)
    return [p for p in seen.processes if seen.answers(p.name) or p.name in away]


def params_of(
    client: Client, process: ProcessRecord, names: list[str], timeout: float
) -> dict[str, Any]:
    """Its parameters; waits (s) for one that is just being restarted.

    Raises Unreachable for a process that is away, TimedOut for one that is there and silent.
    """
    name = process.name
    if process.state == "down":
        raise Unreachable(f"{name} is down", f"`quadctl node logs {name}` may tell why")
    service = get_params(name)
    try:
        return client.call(service, GetParamsRequest(names), timeout).values
    except (TimedOut, Unreachable) as error:
        about_call = service.key(client.vehicle) in error.message
        if isinstance(error, TimedOut):
            if not about_call:
                raise
            # Part of the time that was given may have gone by before.
            asked = f"{name} did not answer within {client.timeout:g} s"
            raise TimedOut(asked, error.hint) from error
        if process.pid and process.state == "ready" and not has_ended(process.pid):
            # A second after it froze, the hub takes it for gone; the supervisor sees its process.
            raise TimedOut(
                f"{name} does not answer, although its process {process.pid} is there",
                "it is frozen or busy: `quadctl status`",
            ) from error
        if not about_call:
            raise
        raise Unreachable(f"{name} did not answer: {_why_away(process)}", error.hint) from error


def _why_away(process: ProcessRecord) -> str:
    if process.pid and has_ended(process.pid):
        return f"its process {process.pid} has ended"
    return "it has gone from the bus" if process.state == "ready" else f"it is {process.state}"
