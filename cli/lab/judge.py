"""Flights of a student's nodes in place of ours, row by row of a rubric, in lock-step."""

import math
import os
import re
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from random import Random
from secrets import token_hex
from textwrap import dedent
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from quadctl.cli.lab.causes import last_cause
from quadctl.cli.lab.extra import prints
from quadctl.cli.lab.flown import TIME_TO_ARRIVE, FlownMission, Outcome, Witness
from quadctl.cli.lab.rubric import RowVerdict, Rubric, RubricRow
from quadctl.cli.lab.verdict import judge, random_flight
from quadctl.cli.mission.fly import MissionFlight
from quadctl.cli.mission.mission import CageStep, CallStep, GotoStep, MissionFile
from quadctl.cli.temporary_run import temporary_run
from quadctl.schemas.messages import Waypoint
from quadctl.schemas.params import Params
from quadctl.schemas.topics import PRESSURE, REQUEST
from quadctl.services.campaign.mission import (
    FAR,
    CageEvent,
    Conditions,
    GotoEvent,
    mission as random_mission,
)
from quadctl.services.runtime import run_files
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.bus.session import LEASE_PATIENT_MS
from quadctl.services.runtime.errors import QuadctlError, TimedOut, Unreachable
from quadctl.services.runtime.executor import HAS_BLOCKED
from quadctl.services.runtime.process_table import NOT_READY, QUICK
from quadctl.services.runtime.procfs import has_ended
from quadctl.services.runtime.realm import DEFAULT, Realm
from quadctl.services.runtime.run_files import ProcessRecord
from quadctl.services.runtime.supervisor import control
from quadctl.services.runtime.supervisor.launch import Launch
from quadctl.services.runtime.supervisor.logs import ABOUT

_PATIENCE = LEASE_PATIENT_MS / 1000
"""Seconds that a reply may take, and a pose: on a busy machine a node waits long for a processor."""
_LONGEST = 10_000
"""Most characters of a row's output: a hand-in writes parts of it."""
RECORDING = "flight.mcap"
"""File of the evidence with the longest run."""
Wrap = Callable[[Realm, list[str]], list[str]]
"""Change of a node's command for a run, e.g. to one in a sandbox."""


class RowResult(Struct, frozen=True):
    """Result of a row, as `lab check --json` prints it."""

    name: str
    number: str
    ok: bool
    score: float
    max_score: float
    output: str
    visible: bool
    hint: str = ""

    @classmethod
    def of(cls, row: RubricRow, verdict: RowVerdict) -> "RowResult":
        """Return the result of a row with this verdict on its flight."""
        return cls(
            row.name, row.number, verdict.ok, row.points if verdict.ok else 0.0, row.points,
            verdict.output[:_LONGEST], row.visible, "" if verdict.ok else row.hint,
        )  # fmt: skip

    @classmethod
    def without_flight(cls, row: RubricRow, why: str) -> "RowResult":
        """Return the result of a row whose flight ended early, or never began.

        It has no hint: a row's hint is about its flight, and the cause is another.
        """
        return cls(row.name, row.number, False, 0.0, row.points, why[:_LONGEST], row.visible)


def log_of(node: str) -> str:
    """Return the file of the evidence with a node's log."""
    return f"{node}.log"


NOT_FLOWN = "not flown: the time for this hand-in is over (--wall)"


def fly(
    folder: Path,
    nodes: Mapping[str, list[str]],
    rubric: Rubric,
    *,
    until: float,
    wrap: Wrap,
    evidence: Path | None,
) -> Iterator[RowResult]:
    """Fly each row against its node, which runs in `folder`; yield a result for each, as flown.

    A row flies with the student's node that it is about and with ours for the other: so a fault
    costs the rows of one node only. Rows with the same node and parameters share a run, and each
    begins with a new boot. After `until`, on the monotonic clock, the rows that are left give 0. `evidence` is a
    folder for the recording of the longest run, and for the log of each node from all its runs.
    """
    groups: dict[tuple[str, str], list[_Flight]] = {}
    for row, made in zip(rubric.rows, rubric.missions, strict=True):
        groups.setdefault((row.about, repr(row.set)), []).append((row, made))
    pending = deque((node, _SETTINGS, flights) for (node, _), flights in groups.items())
    there = [flights for (node, _), flights in groups.items() if node in nodes]
    longest = max(there, key=len, default=[])
    hung: dict[str, str] = {}
    while pending:
        node, settings, flights = pending.popleft()
        if node not in nodes:
            hung[node] = f"quad.toml names no {node} node under [processes]"
        if node in hung:
            yield from (RowResult.without_flight(row, hung[node]) for row, _ in flights)
            continue
        params = flights[0][1].params
        assert params is not None  # noqa: S101 - a rubric's missions have their own
        name = f"lab-{os.getpid()}-{token_hex(2)}"
        own = replace(
            params,
            processes={node: wrap(Realm(name), nodes[node])},
            dynamics=replace(params.dynamics, **settings),
        )
        file = str(evidence / RECORDING) if evidence and flights is longest else ""
        idle = ["pressure"] if node == "safety" else []  # no row about safety reads the barometer
        launch = Launch(name, {DEFAULT: own}, idle, str(folder), file, patient=True, guarded=True)
        run = _LabRun(launch, node, evidence / log_of(node) if evidence else None)
        yield from run.fly(flights, until)
        if run.hangs:
            hung[node] = run.hangs
        if run.out_of_step:
            pending.append((node, _SLOW, run.out_of_step))


_Flight = tuple[RubricRow, MissionFile]
_SETTINGS: dict[str, Any] = {}
_SLOW: dict[str, Any] = {"speed": 2.0}
"""Parameters of dynamics for a node with a clock of its own: slow for it, and still in lock-step."""
_IN_STEP = 0.9
"""Share of the readings of a flight that a node which keeps step publishes at least."""


class _OutOfStep(Exception):
    """Flight in which a node has read its sensor by a clock of its own, and too seldom."""


class _LabRun:
    """Run with a student's node, in which rows are flown; `log` is a file for the node's lines.

    Afterwards `hangs` has why the node is waited for no more, empty if it is, and `out_of_step` the
    rows to be flown again, slowly.
    """

    def __init__(self, launch: Launch, name: str, log: Path | None) -> None:
        self.hangs, self.out_of_step = "", list[_Flight]()
        self._launch, self._name, self._log, self._logged = launch, name, log, b""

    def fly(self, flights: Sequence[_Flight], until: float) -> Iterator[RowResult]:
        """Fly rows up to a time; yield their results."""
        done, folder = 0, Path(self._launch.folder)
        try:
            with (
                temporary_run(self._launch) as realm,
                Client(self._launch.realm, DEFAULT, timeout=_PATIENCE) as client,
            ):
                node = _StudentNode(realm, self._name, folder)
                try:
                    for result in self._fly_each(client, node, flights, until):
                        if result is not None:
                            yield result
                        done += 1
                finally:
                    self._logged = node.logged()  # the run's folder goes with the run
        except QuadctlError as problem:
            # The node did not start, or the run has gone: its rows give 0, the others are flown.
            self._logged += f"{problem.message}\n".encode()
            for row, _ in flights[done:]:
                yield RowResult.without_flight(row, _with_cause(problem.message, folder))
            if f"{self._name} {NOT_READY}" in problem.message:
                self.hangs = f"not flown: {problem.message.splitlines()[0]}"
        finally:
            if self._log is not None:
                rows = ", ".join(row.number for row, _ in flights)
                with suppress(OSError), self._log.open("ab") as out:
                    out.write(f"== rows {rows}\n".encode() + self._logged)

    def _fly_each(
        self, client: Client, node: "_StudentNode", flights: Sequence[_Flight], until: float
    ) -> Iterator[RowResult | None]:
        before = hangs = ""
        for row, made in flights:
            if time.monotonic() > until:
                yield RowResult.without_flight(row, NOT_FLOWN)
            elif hangs and hangs == before:
                # What hangs in one row and again in the next is waited for no more.
                yield RowResult.without_flight(row, f"not flown: {hangs}")
            elif why := node.renew():
                yield RowResult.without_flight(row, why)
            else:
                before = hangs
                try:
                    result, hangs = _fly_row(client, node, self._launch.params, row, made)
                    yield result
                except _OutOfStep:
                    self.out_of_step.append((row, made))
                    yield None


_LAST_LINES = "; its last lines:"
"""End of a supervisor's first line on a process that does not stay up."""


def _with_cause(message: str, folder: Path) -> str:
    """Return a message with the cause of a failed start in its first line."""
    first, *lines = message.splitlines()
    if not first.endswith(_LAST_LINES):
        return message
    written = [line for line in dedent("\n".join(lines)).splitlines() if line.strip()]
    cause = last_cause(written, folder) or (written[-1] if written else "it ends, and logs nothing")
    return "\n".join((f"{first.removesuffix(_LAST_LINES)}: {cause}", *lines))


def _fly_row(
    client: Client, node: "_StudentNode", params: Params, row: RubricRow, made: MissionFile
) -> tuple[RowResult, str]:
    """Return the result of a row, and what hung in it; empty if nothing did."""
    try:
        if row.expect == "random_flights":
            verdict = _random_flights(client, node, params, row)
        else:
            flown = _flown(client, node, params, made, row)
            few = len(flown.readings) < _IN_STEP * PRESSURE.hz * made.end
            if few and row.about == "pressure" and not params.dynamics.speed:
                raise _OutOfStep
            if row.expect == "prints":
                flown = flown._replace(log=node.written(lambda log: prints(row, log).ok))
            verdict = judge(row, flown)
    except QuadctlError as problem:
        silent = (
            f"{row.about} keeps the simulation waiting" if isinstance(problem, TimedOut) else ""
        )
        why = node.explained(problem)
        return RowResult.without_flight(row, why), node.blocked() or silent
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # A hand-in may answer anything, and its other rows are flown.
        what = f"{type(error).__name__}: {error}"
        why = f"not judged: an answer of {row.about} is not as our own node's: {what}"
        return RowResult.without_flight(row, why), ""
    if not verdict.ok and (crash := node.crash()):
        return RowResult.without_flight(row, crash), ""
    return RowResult.of(row, verdict), "" if verdict.ok else node.blocked()


class _StudentNode:
    """Student's node in a run: whether it has ended since a row began, and why."""

    def __init__(self, realm: Realm, name: str, folder: Path) -> None:
        self._realm, self._name, self._folder = realm, name, folder
        self._log = realm.logs / f"{name}.log"
        self._before = self._record()
        self._begin = 0

    def renew(self) -> str:
        """Begin a row; after a crash, or if it is blocked, start the node anew first.

        Returns the crash if the node is left down: every row that is left has that verdict.
        """
        begin = None
        if crash := self.crash() or self.blocked():
            # One that ends again and again is ready for moments: wait until it is left down.
            looping = self._record().restarts > self._before.restarts + 1
            if not self._stays_up(QUICK / 2 if looping else 0.0):
                return crash
            # What the new one writes may come before the record of it.
            begin = len(self._written(0))
            # The supervisor counts quick ends. A new start makes it forget those of other rows.
            asked = control.request_restart(self._realm, self._name)
            try:
                control.wait_restarted(self._realm, self._name, asked, math.inf)
            except QuadctlError:
                return crash
        self._before = self._record()
        self._begin = len(self._written(0)) if begin is None else begin
        return ""

    def crash(self) -> str:
        """Return how the node has crashed since the row began, empty if it has not."""
        now = self._record()
        if now.state == "ready" and now.pid == self._before.pid:
            return ""
        if blocked := self.blocked():
            return "\n".join((blocked, *self._last_lines()))
        ended = self._how_it_ended()
        until = time.monotonic() + (_LOGGED if ended in _EXPLAINED else 0)
        while not (cause := self._error()) and time.monotonic() < until:
            time.sleep(_LOOK)
        cause = cause or ended
        return "\n".join((f"{self._name} crashed: {cause}", *self._last_lines()))

    def blocked(self) -> str:
        """Return which handler or loop has not returned since the row began, empty if all have."""
        lines = [line for line in self._lines() if HAS_BLOCKED in line]
        return f"{self._name} is blocked: {lines[-1]}" if lines else ""

    def check(self) -> None:
        """Raise QuadctlError if it has crashed or is blocked, so that a flight need not wait for it."""
        if self.crash() or self.blocked():
            raise QuadctlError(f"{self._name} keeps the simulation waiting")

    def explained(self, problem: QuadctlError) -> str:
        """Return what ended a row's flight: the node's crash, its error in a handler, or neither."""
        # The supervisor writes its record a moment after a process has ended, or later if it is busy.
        began = time.monotonic()
        while not (crash := self.crash()):
            waited = time.monotonic() - began
            if waited > (_NOTICED_AT_LAST if has_ended(self._before.pid) else _NOTICED):
                break
            time.sleep(_LOOK)
        if crash:
            return crash
        cause = self.blocked()
        if not cause and (error := self._error()):
            cause = f"{self._name} failed: {error}"
        return "\n".join((*filter(None, [cause]), problem.message, *self._last_lines()))

    def written(self, is_all: Callable[[list[str]], bool]) -> list[str]:
        """Return the lines that the node has logged since it was started, as soon as they are all."""
        until = time.monotonic() + _LOGGED
        while not is_all(lines := self._written(0).decode(errors="replace").splitlines()):
            if time.monotonic() > until:
                break
            time.sleep(_LOOK)
        return lines

    def logged(self) -> bytes:
        """Return the last part of all that the node has logged in this run."""
        return self._written(0)[-_MOST_LOGGED:]

    def _record(self) -> ProcessRecord:
        run = run_files.read(self._realm)
        return next(node for node in run.nodes if node.name == self._name)

    def _stays_up(self, seconds: float) -> bool:
        """Wait until the node has been ready for so long, or its supervisor leaves it down; return which."""
        since, ready = time.monotonic(), self._record()
        while (now := self._record()).state != "down":
            if now.state != "ready" or now.pid != ready.pid:
                since, ready = time.monotonic(), now
            elif time.monotonic() - since >= seconds:
                return True
            time.sleep(_LOOK)
        return False

    def _error(self) -> str:
        return last_cause(self._lines(), self._folder)

    def _how_it_ended(self) -> str:
        """Return the exit code or signal of the last end, as the supervisor has logged it."""
        text = (self._realm.logs / "up.log").read_text("utf-8", errors="replace")
        ends = re.findall(rf"^{self._name} ended \((.+?)\)", text, re.MULTILINE)
        return ends[-1] if ends else "it ended, and logged nothing"

    def _last_lines(self, most: int = 3) -> list[str]:
        return [f"{self._name}: {line}" for line in self._lines()[-most:]]

    def _lines(self) -> list[str]:
        """Return what the node has logged since the row began, without the supervisor's lines."""
        lines = self._written(self._begin).decode(errors="replace").splitlines()
        return [line for line in lines if not line.startswith(ABOUT)]

    def _written(self, begin: int) -> bytes:
        try:
            data = self._log.read_bytes()
        except OSError:
            return b""
        # A full log is replaced by a new one.
        return data[begin:] if begin <= len(data) else data


_EXPLAINED = {"exit 1", "exit 137"}
"""Ends of a process by an error that it did not catch, or by a limit: its log has a traceback, or the limit."""
_LOGGED = 2.0
"""Seconds until a line that a node has printed is in its log."""
_MOST_LOGGED = 1_000_000
"""Bytes of a run's log that are kept: a hand-in may fill it."""
_NOTICED, _NOTICED_AT_LAST, _LOOK = 0.3, 10.0, 0.02
"""Seconds until a process ends, until its end is in the record, and between two looks at both."""


def _random_flights(
    client: Client, node: "_StudentNode", params: Params, row: RubricRow
) -> RowVerdict:
    for seed in range(row.seed, row.seed + row.flights):
        flown = _flown(client, node, params, _random(seed, params, row.seconds), row)
        verdict = random_flight(flown)
        if not verdict.ok:
            return RowVerdict(False, f"seed {seed}: {verdict.output}")
    return RowVerdict(
        True, f"{row.flights} flights: never beyond the cage, each goal rightly answered"
    )


def _random(seed: int, params: Params, seconds: float) -> MissionFile:
    """Return the goals and cage commands of a random mission of the campaign."""
    cage = params.safety.virtual_cage
    given: dict[str, Any] = {
        "safety.virtual_cage.x": cage.x, "safety.virtual_cage.y": cage.y, "safety.virtual_cage.z": cage.z,
        "safety.cage_on": params.safety.cage_on, "safety.acceptance_range": params.safety.acceptance_range,
    }  # fmt: skip
    rows: list[Any] = []
    for event in random_mission(seed, Random(seed), Conditions(seconds, given=given)).rows:
        # After the take-off, whose length is the student's.
        at = event.at + _TAKEOFF
        if isinstance(event, CageEvent):
            rows.append(CageStep(at, event.on))
        elif isinstance(event, GotoEvent) and all(
            abs(value) <= FAR for value in (event.x, event.y, event.z)
        ):
            rows.append(GotoStep(at, event.x, event.y, event.z))
    # The last goal, too, has time to be reached.
    return MissionFile(rows, seconds + _TAKEOFF + TIME_TO_ARRIVE)


_TAKEOFF = 3.0
"""Simulated seconds for the take-off."""


def _flown(
    client: Client, node: "_StudentNode", params: Params, made: MissionFile, row: RubricRow
) -> FlownMission:
    others = ["pressure"] if row.about == "pressure" else []
    # A node that is there has announced all that it serves; the record may know of it a moment before.
    until = time.monotonic() + _NOTICED_AT_LAST
    while row.about not in client.nodes() and not node.crash() and time.monotonic() < until:
        time.sleep(_LOOK)
    served = {endpoint.name for endpoint in client.endpoints("@srv")}
    for step in made.rows:
        named = isinstance(step, CallStep) and step.type_name
        if not named and (service := step.call()[0].name) not in served:
            raise Unreachable(f"{step}: {row.about} does not serve {service}")
    nodes = ("dynamics", "safety", *others)
    flight = MissionFlight(client, made, Witness, nodes, on_silence=node.check)
    waypoints = deque(row.waypoints)

    def publish_due(now: float) -> None:
        while waypoints and waypoints[0].at <= now:
            step = waypoints.popleft()
            requests.put(codec.encode(Waypoint(step.x, step.y, step.z)))

    if waypoints:
        requests = client.raw_publisher(REQUEST.key(client.vehicle), codec.encoding(REQUEST.type))
    try:
        flight.fly(publish_due)
    except TimedOut as problem:
        if fault := flight.record.unanswered():
            raise TimedOut(f"{problem.message}; {fault}", problem.hint) from problem
        raise
    record = flight.record
    outcomes = [Outcome(step, call.reply, call.problem) for step, call in flight.rows]
    return FlownMission(
        params, outcomes, record.poses, record.states, record.readings, record.setpoints
    )
