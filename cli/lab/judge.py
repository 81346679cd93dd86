"""Flights of a student's nodes in place of ours, row by row of a rubric, in lock-step."""

import os
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from itertools import groupby
from pathlib import Path
from random import Random
from secrets import token_hex
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from quadctl.cli.lab.rubric import Rubric, RubricRow
from quadctl.cli.lab.verdict import FlownMission, Outcome, RowVerdict, judge, random_flight
from quadctl.cli.mission.fly import MissionFlight
from quadctl.cli.mission.mission import CageStep, GotoStep, MissionFile
from quadctl.cli.temporary_run import temporary_run
from quadctl.schemas.messages import Pose, Pressure, SafetyState
from quadctl.schemas.params import Params
from quadctl.services.campaign.mission import FAR, CageEvent, Conditions, GotoEvent
from quadctl.services.campaign.mission import mission as random_mission
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import Invalid, QuadctlError
from quadctl.services.runtime.params.load import check, read
from quadctl.services.runtime.process_table import table
from quadctl.services.runtime.realm import DEFAULT, Realm
from quadctl.services.runtime.supervisor.launch import Launch

NODES = ("safety", "pressure")
"""Nodes that a student may hand in."""
_TIMEOUT = 3.0
"""Seconds that a reply may take, and a pose."""
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
        """Return the result of a row with this verdict."""
        return cls(
            row.name, row.number, verdict.ok, row.points if verdict.ok else 0.0, row.points,
            verdict.output, row.visible, "" if verdict.ok else row.hint,
        )  # fmt: skip


NOT_FLOWN = RowVerdict(False, "not flown: the time for this hand-in is over (--seconds)")


class Witness:
    """Every message of one boot up to a time (s)."""

    def __init__(self, boot: str, end: float) -> None:
        self.stamp = -1.0
        self.poses: list[Pose] = []
        self.states: list[SafetyState] = []
        self.readings: list[Pressure] = []
        self._boot, self._end = boot, end

    def add(self, message: Pose | SafetyState | Pressure) -> None:
        """Take a message; raise QuadctlError for a pose that is missing or not from dynamics."""
        if isinstance(message, Pose):
            if message.boot == self._boot:
                self._add(message)
        elif isinstance(message, SafetyState):
            if message.boot == self._boot:
                self.states.append(message)
        elif message.stamp <= self._end:
            # A reading has no boot: those of its time or later belong to the one before.
            while self.readings and self.readings[-1].stamp >= message.stamp:
                self.readings.pop()
            self.readings.append(message)

    def check(self, _values: Mapping[str, Any], _changes: Iterable[Any]) -> None:
        """Raise QuadctlError if the flight has not reached its end."""
        if self.stamp < self._end:
            raise QuadctlError(f"the flight ended at {self.stamp:g} s of {self._end:g} s")

    def _add(self, pose: Pose) -> None:
        count = len(self.poses)
        # In lock-step an unanswered pose is published again; each comes once from dynamics.
        if pose.seq < count and pose == self.poses[pose.seq]:
            return
        if pose.seq != count:
            raise QuadctlError(
                f"pose {pose.seq} came {'twice, and differs' if pose.seq < count else 'too early'}:"
                " dynamics alone may publish poses"
            )
        self.poses.append(pose)
        self.stamp = pose.stamp


def nodes_in(folder: Path) -> dict[str, list[str]]:
    """Return the commands of a student's nodes, from the quad.toml in a folder.

    Raises Invalid if it is missing or unreadable, names no node, or one that must be ours.
    """
    file = folder / "quad.toml"
    tables = read(file, "`quadctl lab new DIR` writes one").get("processes", {})
    if not isinstance(tables, dict) or not tables:
        raise Invalid(
            f"{file} names no node under [processes]", '[processes] safety = "python my_safety.py"'
        )
    for name in tables:
        if name not in NODES:
            raise Invalid(
                f"{file}: processes.{name}: the lab flies its own {name}",
                f"a hand-in may replace {' and '.join(NODES)}",
            )
    commands = check({"processes": tables}, str(file)).processes
    return {row.name: list(row.command) for row in table(commands) if row.stranger}


def fly(
    folder: Path,
    nodes: Mapping[str, list[str]],
    rubric: Rubric,
    *,
    until: float,
    record: str = "",
    wrap: Wrap = lambda _realm, command: command,
) -> Iterator[RowResult]:
    """Fly each row against these nodes, which run in `folder`; yield a result for each, in order.

    Rows with the same parameters share a run, and each begins with a new boot. After `until`, on
    the monotonic clock, the rows that are left give 0. `record` is a file for the longest run.
    """
    pairs = zip(rubric.rows, rubric.missions, strict=True)
    groups = [list(group) for _, group in groupby(pairs, key=lambda pair: pair[0].set)]
    for rows in groups:
        if all(_missing(row, nodes) for row, _ in rows):
            # Nothing of theirs would fly.
            yield from (RowResult.of(row, _missing(row, nodes) or NOT_FLOWN) for row, _ in rows)
            continue
        params = rows[0][1].params
        assert params is not None  # noqa: S101 - a rubric's missions have their own
        name = f"lab-{os.getpid()}-{token_hex(2)}"
        wrapped = {node: wrap(Realm(name), command) for node, command in nodes.items()}
        own = replace(params, processes=wrapped)
        file = record if rows is max(groups, key=len) else ""
        launch = Launch(name, {DEFAULT: own}, [], str(folder), file, patient=True)
        yield from _fly_run(launch, rows, nodes, until)


def _missing(row: RubricRow, nodes: Collection[str]) -> RowVerdict | None:
    if row.node in nodes:
        return None
    return RowVerdict(False, f"quad.toml names no {row.node} node under [processes]")


def _fly_run(
    launch: Launch,
    rows: list[tuple[RubricRow, MissionFile]],
    nodes: Collection[str],
    until: float,
) -> Iterator[RowResult]:
    params = launch.params
    done = 0
    try:
        with (
            temporary_run(launch) as realm,
            Client(launch.realm, DEFAULT, timeout=_TIMEOUT) as client,
        ):
            for row, made in rows:
                verdict = _missing(row, nodes)
                if verdict is None and time.monotonic() > until:
                    verdict = NOT_FLOWN
                yield RowResult.of(row, verdict or _fly_row(client, realm, params, row, made))
                done += 1
    except QuadctlError as problem:
        # The nodes did not start, or the run has gone: its rows give 0, the others are flown.
        for row, _ in rows[done:]:
            yield RowResult.of(row, RowVerdict(False, problem.message))


def _fly_row(
    client: Client, realm: Realm, params: Params, row: RubricRow, made: MissionFile
) -> RowVerdict:
    try:
        if made.rows:
            return judge(row, _flown(client, params, made, row.node))
        return _random_flights(client, params, row)
    except QuadctlError as problem:
        return RowVerdict(False, "\n".join((problem.message, *_last_lines(realm, row.node))))


def _random_flights(client: Client, params: Params, row: RubricRow) -> RowVerdict:
    for seed in range(row.seed, row.seed + row.flights):
        flown = _flown(client, params, _random(seed, params, row.seconds), row.node)
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
    return MissionFile(rows, seconds + _TAKEOFF)


_TAKEOFF = 3.0
"""Simulated seconds for the take-off."""


def _flown(client: Client, params: Params, made: MissionFile, node: str) -> FlownMission:
    nodes = ("dynamics", "safety", "pressure") if node == "pressure" else ("dynamics", "safety")
    flight = MissionFlight(client, made, Witness, nodes)
    flight.fly(lambda _at: None)
    record = flight.record
    outcomes = [Outcome(step, call.reply, call.problem) for step, call in flight.rows]
    return FlownMission(params, outcomes, record.poses, record.states, record.readings)


def _last_lines(realm: Realm, node: str, most: int = 3) -> list[str]:
    try:
        lines = (realm.logs / f"{node}.log").read_text("utf-8", errors="replace").splitlines()
    except OSError:
        return []
    return [f"{node}: {line}" for line in lines[-most:]]
