"""`fly`: every call of a mission scheduled ahead, then a reset and the flight."""

import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import msgspec

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg
from quadctl.cli.mission.digest import Record
from quadctl.cli.mission.mission import MissionFile, Row, mission
from quadctl.cli.progress import Progress
from quadctl.schemas.services import (
    CalibrateRequest,
    CalibrateResponse,
    GetParamsRequest,
    GotoResponse,
    ResetRequest,
    ToggleCageRequest,
)
from quadctl.schemas.topics import (
    CALIBRATE,
    POSE,
    PRESSURE,
    RESET,
    STATE,
    TOGGLE_CAGE,
    Topic,
    get_params,
)
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.bus.scheduled_calls import FutureCall
from quadctl.services.runtime.errors import QuadctlError, Refused, TimedOut
from quadctl.services.runtime.params.load import read

NODES = ("dynamics", "pressure", "safety")
_BACKLOG = 200_000
"""Messages that may wait while this process does not get its turn; none must be lost."""
_LOOK = 0.02
"""Seconds between looks at what has come: a wake for each message would slow down the flight."""
_PATIENCE = 60.0
_SLOWER = 20.0
"""A mission may take a minute and this many times as long as at the speed that is asked for."""


class MissionFlight:
    """One flight of a mission, from a new boot on."""

    def __init__(self, client: Client, mission: MissionFile) -> None:
        """Raises Unreachable or TimedOut where a node does not answer."""
        self._client, self._mission = client, mission
        self.parameters = self._parameters()
        self._boot = os.urandom(4).hex()
        speed = self.parameters["dynamics.speed"] or 1.0
        self._patience = _PATIENCE + _SLOWER * mission.end / speed
        self.record = Record(self._boot, mission.end, self.parameters["pressure.rate"])
        self._awaited, self._ended = len(NODES), threading.Event()
        topics: tuple[Topic[Any], ...] = (POSE, STATE, PRESSURE)
        self._readings = client.subscribe(*topics, backlog=_BACKLOG)
        self.rows: list[tuple[Row, FutureCall[Any, Any]]] = []
        self._ends: list[FutureCall[Any, Any]] = []

    def fly(self, on_progress: Callable[[float], None]) -> None:
        """Fly it to its end, telling `on_progress` the simulated time (s).

        Raises what keeps the record from being whole; the vehicle is then back at its start, and
        what was left of the mission is dropped.
        """
        self._call_ahead()
        # A known beginning. Each answer also says that the calls before it have arrived.
        cage_on = bool(self.parameters["safety.cage_on"])
        if self._client.latest(STATE).cage_on is not cage_on:
            # Not said in vain: a student may fly, and not say it.
            self._client.call(TOGGLE_CAGE, ToggleCageRequest(cage_on))
        self._client.call(CALIBRATE, CalibrateRequest(zero=False))
        try:
            self._client.call(RESET, ResetRequest(), boot=self._boot)
            self._follow(on_progress)
            self._check()
        except BaseException:
            with suppress(QuadctlError):
                self._client.call(RESET, ResetRequest())
            raise

    def _call_ahead(self) -> None:
        calls = [(row, *row.call()) for row in self._mission.rows]
        for service in {service.name: service for _, service, _ in calls}.values():
            self._client.wait_for_server(service)
        for row, service, request in calls:
            # The outcome of a row is looked at when the flight is over.
            self.rows.append((row, self._ahead(service, request, row.at, lambda: None)))
        # While a node holds a call it is in lock-step: its last one is for the end.
        for node in NODES:
            asked = GetParamsRequest([node])
            end = self._ahead(get_params(node), asked, self._mission.end, self._settle)
            self._ends.append(end)

    def _ahead(
        self, service: Any, request: Any, at: float, settled: Callable[[], None]
    ) -> FutureCall[Any, Any]:
        return FutureCall(
            self._client,
            service,
            request,
            boot=self._boot,
            at=at,
            patience=self._patience,
            settled=settled,
        )

    def _settle(self) -> None:
        self._awaited -= 1
        if not self._awaited or any(end.problem for end in self._ends):
            self._ended.set()

    def _follow(self, on_progress: Callable[[float], None]) -> None:
        """Hear all that is said until the three nodes have come to the end."""
        patience, record = self._client.timeout, self.record
        moved = time.monotonic()
        while not self._ended.wait(_LOOK):
            if self._take_in():
                moved = time.monotonic()
                on_progress(record.stamp)
            elif time.monotonic() > moved + patience and record.stamp < self._mission.end:
                raise TimedOut(
                    f"no new pose for {patience:g} s: the clock stands at {max(record.stamp, 0):g} s",
                    "`quadctl status` shows whether dynamics and safety are up",
                )
        # Whoever has come to the end has said before what it had to say.
        self._take_in()

    def _take_in(self) -> bool:
        """Record what has come by now; whether that brought the flight on."""
        before = self.record.stamp
        for _ in range(self._readings.waiting):
            if (message := self._readings.next(0)) is not None:
                self.record.add(message)
        return self.record.stamp > before

    def _check(self) -> None:
        for call in (*self._ends, *(call for _, call in self.rows)):
            # A refusal is an outcome like any other; a call that was not made at its time is not.
            if call.problem is not None and not isinstance(call.problem, Refused):
                raise call.problem
        self.record.check()

    def _parameters(self) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for node in NODES:
            values |= self._client.call(get_params(node), GetParamsRequest([])).values
        return values


def fly(
    options: Options, mission_file: Annotated[Path, Arg("A mission, TOML.", "MISSION")]
) -> None:
    """Fly a mission from the vehicle's start, each row at its simulated time.

    Prints the SHA-256 of every pose, of safety's transitions and of the barometer's readings: the
    same for every flight of the mission with these parameters, whatever the speed and the load.

    Example: quadctl fly examples/mission.toml
    """
    plan = mission(read(mission_file), str(mission_file))
    with context.connect(options) as client:
        flight = MissionFlight(client, plan)
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


def _outcome(call: FutureCall[Any, Any]) -> dict[str, Any]:
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
