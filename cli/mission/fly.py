"""`fly`: every call of a mission scheduled ahead, then a reset and the flight."""

import os
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar

import msgspec
from msgspec.structs import replace

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg
from quadctl.cli.mission.digest import FlightRecord, Record
from quadctl.cli.mission.mission import NODES, CallStep, MissionFile, ParamStep, Row, mission
from quadctl.cli.progress import Progress
from quadctl.cli.temporary_run import temporary_run
from quadctl.schemas.messages import Poses
from quadctl.schemas.params import Params, in_lockstep
from quadctl.schemas.services import (
    CalibrateRequest,
    CalibrateResponse,
    GetParamsRequest,
    GotoResponse,
    ResetRequest,
    SetParamsRequest,
    SetParamsResponse,
    ToggleCageRequest,
)
from quadctl.schemas.topics import (
    CALIBRATE,
    POSE,
    POSES,
    RESET,
    STATE,
    TOGGLE_CAGE,
    Topic,
    get_params,
    set_params,
)
from quadctl.services.runtime import process_table, run_files
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.bus.scheduled_calls import FutureCall
from quadctl.services.runtime.bus.session import LEASE_PATIENT_MS
from quadctl.services.runtime.errors import (
    Invalid,
    NotReady,
    QuadctlError,
    Refused,
    TimedOut,
    UsageError,
)
from quadctl.services.runtime.files import read_text
from quadctl.services.runtime.params import catalogue
from quadctl.services.runtime.params.load import check, read
from quadctl.services.runtime.params.names import nearest
from quadctl.services.runtime.realm import DEFAULT, Realm, listed
from quadctl.services.runtime.supervisor.launch import Launch

_BACKLOG = 200_000  # messages that may wait while this process is not scheduled; none may be lost
_LOOK = 0.02  # s between two reads: a wake for each message would slow down the flight
_SILENCE = 1.0  # s without a pose, which may have a cause
_PATIENCE = 60.0
_SLOWER = 20.0
"""A mission may take _PATIENCE s plus this many times its length at the requested speed."""
_EXAMPLE = "`quadctl init --mission` writes one to begin with, mission.toml"


R = TypeVar("R", bound=FlightRecord)


class MissionFlight(Generic[R]):
    """One flight of a mission, in a new boot."""

    def __init__(
        self,
        client: Client,
        mission: MissionFile,
        record: Callable[[str, float], R],
        nodes: Collection[str] = NODES,
        *,
        silence: float = 0.0,
        on_silence: Callable[[], None] = lambda: None,
    ) -> None:
        """Read the parameters; raise Unreachable or TimedOut if a node does not answer.

        `record` makes the record of a boot up to a time (s); of the lab's nodes, `nodes` take part.
        A flight is given up when no pose comes for the longer of `silence` and the client's timeout (s).
        Meanwhile `on_silence` is called again and again, and may raise.
        """
        self._on_silence = on_silence
        self._client, self._mission, self._nodes = client, mission, nodes
        self._silence = max(silence, client.timeout)
        self.parameters: dict[str, Any] = {}
        for node in nodes:
            self.parameters |= client.call(get_params(node), GetParamsRequest([])).values
        self._boot = os.urandom(4).hex()
        speed = self.parameters["dynamics.speed"] or 1.0
        self._patience = _PATIENCE + _SLOWER * mission.end / speed
        self.record = record(self._boot, mission.end)
        self._awaited, self._ended = len(nodes), threading.Event()
        self._readings = client.subscribe(*_fewer(client, self.record.topics), backlog=_BACKLOG)
        self.rows: list[tuple[Row, FutureCall[Any, Any]]] = []
        self._ends: list[FutureCall[Any, Any]] = []

    def fly(self, on_progress: Callable[[float], None]) -> None:
        """Fly to the end, reporting the simulated time (s) to `on_progress`.

        Raises if the record is incomplete. After any error the vehicle is back at its start and
        the rest of the mission is dropped. Parameters that rows have set are as before.
        """
        self._call_ahead()
        # Start from a known state. Each answer also confirms that the earlier calls have arrived.
        cage_on = bool(self.parameters["safety.cage_on"])
        if self._client.latest(STATE).cage_on is not cage_on:
            # Only if needed: the role of a student may fly, but not toggle the cage.
            self._client.call(TOGGLE_CAGE, ToggleCageRequest(cage_on))
        if "pressure" in self._nodes:
            self._client.call(CALIBRATE, CalibrateRequest(zero=False))
        try:
            self._client.call(RESET, ResetRequest(), boot=self._boot)
            self._follow(on_progress)
            self._check()
        except BaseException:
            with suppress(QuadctlError):
                self._client.call(RESET, ResetRequest())
            raise
        finally:
            self._restore()
            self._readings.close()  # else each later flight would be received here, too

    def _call_ahead(self) -> None:
        calls = [(row, *self._named(row).call()) for row in self._mission.rows]
        for service in {service.name: service for _, service, _ in calls}.values():
            self._client.wait_for_server(service)
        for row, service, request in calls:
            # The outcome of a row is read after the flight.
            self.rows.append((row, self._ahead(service, request, row.at, lambda: None)))
        # The answers at the end show that each node has published all before it.
        for node in self._nodes:
            request = GetParamsRequest([node])
            end = self._ahead(get_params(node), request, self._mission.end, self._settle)
            self._ends.append(end)

    def _named(self, row: Row) -> Row:
        """Return a row that calls a service by its key's name; raise Invalid if no service has the type."""
        if not isinstance(row, CallStep) or not row.type_name:
            return row
        served = {found.type: found.name for found in self._client.endpoints("@srv")}
        if row.type_name not in served:
            raise Invalid(
                f"there is no service of the type {row.type_name}",
                nearest(row.type_name, [*served]) or "`quadctl service list` shows their types",
            )
        return replace(row, service=served[row.type_name])

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
        """Record all messages until the three nodes have reached the end."""
        patience, record = self._silence, self.record
        moved = time.monotonic()
        while not self._ended.wait(_LOOK):
            if self._record_waiting():
                moved = time.monotonic()
                on_progress(record.stamp)
            elif time.monotonic() > moved + min(_SILENCE, patience):
                self._on_silence()
                if time.monotonic() > moved + patience and record.stamp < self._mission.end:
                    raise TimedOut(
                        f"no new pose for {patience:g} s: time stopped at {max(record.stamp, 0):g} s",
                        "`quadctl status` shows whether dynamics and safety are up",
                    )
        # A node that has reached the end has published everything before it.
        self._record_waiting()

    def _record_waiting(self) -> bool:
        """Record the messages received so far; return whether they advanced the flight."""
        before = self.record.stamp
        for _ in range(self._readings.waiting):
            if (message := self._readings.next(0)) is not None:
                for each in message.poses if isinstance(message, Poses) else (message,):
                    self.record.add(each)
        if self._readings.lost:
            raise QuadctlError(
                f"{self._readings.lost} messages were lost: they come faster than they can be read",
                "does a node of your own publish without end?",
            )
        return self.record.stamp > before

    def _check(self) -> None:
        for node, end in zip(self._nodes, self._ends, strict=True):
            if isinstance(end.problem, NotReady):
                raise NotReady(
                    f"{node} cannot fly a mission: {end.problem.message}", end.problem.hint
                )
        for call in (*self._ends, *(call for _, call in self.rows)):
            # A refusal is a valid outcome; a call that was not made at its time is not.
            if call.problem is not None and not isinstance(call.problem, Refused):
                raise call.problem
        changes = [
            (row.at, row.values)
            for row, call in self.rows
            if isinstance(row, ParamStep) and call.reply and call.reply.success
        ]
        self.record.check(self.parameters, changes)

    def _restore(self) -> None:
        """Set the parameters that rows have set as before; note on stderr if a node refuses."""
        rows = [row for row in self._mission.rows if isinstance(row, ParamStep)]
        names = {name for row in rows for name in row.values}
        for node in self._nodes:
            before = {
                name: value
                for name, value in self.parameters.items()
                if name in names and name.partition(".")[0] == node
            }
            if not before:
                continue
            try:
                reply = self._client.call(set_params(node), SetParamsRequest(before))
                problem = reply.reason if not reply.success else ""
            except QuadctlError as error:
                problem = error.message
            if problem:
                output.note(f"{', '.join(before)}: still as the mission has set it: {problem}")


def _fewer(client: Client, topics: Sequence[Topic[Any]]) -> list[Topic[Any]]:
    """Return the topics, with all poses of a period in one message if dynamics publishes these."""
    batches = client.subscribe(POSES)
    try:
        batched = batches.next(_SILENCE) is not None
    finally:
        batches.close()
    return [POSES if batched and topic is POSE else topic for topic in topics]


def fly(
    options: Options, mission_file: Annotated[Path, Arg("A mission, TOML.", "MISSION")]
) -> None:
    """Fly a mission from the vehicle's start, each row at its simulated time.

    Prints the SHA-256 of every pose, of safety's transitions and of the barometer's readings: the
    same for every flight of the mission with these parameters, at any speed and load.

    It flies in the running system if that is in lock-step, else in a run of its own with the same
    parameters; a mission with a table [set] of parameters always flies in a run of its own.

    Example: quadctl fly examples/mission.toml
    """
    plan = _read(mission_file)
    with _connection(options, mission_file, plan.params) as (client, own):
        flight = MissionFlight(client, plan, Record, silence=LEASE_PATIENT_MS / 1000 if own else 0)
        began = time.monotonic()
        try:
            with Progress("flying", quiet=options.json) as progress:
                flight.fly(lambda at: progress.update(at / plan.end, f"{at:.1f} s"))
        except KeyboardInterrupt:
            if not own:
                output.note("the mission is dropped: the vehicle is back at its start")
            raise
        wall = time.monotonic() - began
    digests = flight.record.document()
    rows = [msgspec.to_builtins(row) | _outcome(call) for row, call in flight.rows]
    if options.json:
        more = {"rows": rows, "simulated_seconds": plan.end, "wall_seconds": wall}
        more |= {name: flight.parameters[f"dynamics.{name}"] for name in ("speed", "seed")}
        output.document(digests | more)
        return
    output.table(
        (f"{row.at:.2f} s", row, _text(outcome))
        for (row, _), outcome in zip(flight.rows, rows, strict=True)
    )
    output.line(f"{plan.end:g} s of flight in {wall:.1f} s; SHA-256 of the logs:")
    counts = digests["counts"]
    output.table((name, digests[name], f"of {counts[name]}") for name in counts)
    output.line(f"all three  {digests['hash']}")


def _read(file: Path) -> MissionFile:
    try:
        return mission(read(file, _EXAMPLE), str(file))
    except Invalid as problem:
        if isinstance(problem.__cause__, FileNotFoundError):
            others = sorted(str(each) for each in file.parent.glob("*.toml") if _is_mission(each))
            there = f"there is {listed(others)}" if others else ""
            problem.hint = nearest(str(file), others) or there or _EXAMPLE
        raise


def _is_mission(file: Path) -> bool:
    with suppress(Invalid):
        return any(line.startswith("rows") for line in read_text(file, "").text.splitlines())
    return False


@contextmanager
def _connection(
    options: Options, file: Path, params: Params | None
) -> Iterator[tuple[Client, bool]]:
    """Connect to the running system if missions fly in it, else to a run of the mission's own.

    Yields also whether it is an own run.
    """
    if params is not None:
        if options.connect or options.realm_given:
            raise UsageError(
                f"{file} has [set]: it flies in a run of its own, in no other",
                "leave out --realm and --connect; or fly a mission without [set]",
            )
        output.note(f"{file} has [set]: it flies in a run of its own")
        vehicle, folder = options.named or DEFAULT, str(Path.cwd())
        without: list[str] = []
    else:
        with context.connect(options) as client:
            flown = client.call(get_params("dynamics"), GetParamsRequest(["dynamics"])).values
            if in_lockstep(flown):
                yield client, False
                return
            vehicle = client.vehicle
        params, without, folder = _settings_of(options, vehicle)
        output.note(
            f"the realm {options.realm} is in real time: the mission flies in a run of its own, in"
            f" lock-step, with the parameters of {vehicle}"
        )
    launch = Launch(f"fly-{os.getpid()}", {vehicle: params}, without, folder, patient=True)
    with temporary_run(launch), Client(launch.realm, vehicle, timeout=options.timeout) as client:
        yield client, True


def _settings_of(options: Options, vehicle: str) -> tuple[Params, list[str], str]:
    """Return a vehicle's parameters in the realm's run, but as fast as it goes, its missing nodes and its folder."""
    realm = Realm(options.realm)
    if options.connect or not run_files.is_live(realm):
        raise Refused(
            f"the run of {vehicle} is in real time, and missions fly in lock-step",
            "launch it with `--set dynamics.lockstep=true`; or fly in a run of `quadctl up` here,"
            " without --connect",
        )
    run, tables = run_files.read(realm), run_files.tables(realm, vehicle)
    del tables["hub"]  # the addresses are taken
    tables["dynamics"]["speed"] = 0.0
    params = check(tables, f"the realm {realm.name}, as fast as it goes")
    missing = {*process_table.NODES} - {node.name for node in run.nodes}
    return params, sorted(missing), run.folder


def _outcome(call: FutureCall[Any, Any]) -> dict[str, Any]:
    """Return whether a row was accepted, and the reason if not."""
    if call.problem is not None:
        return {"accepted": False, "reason": call.problem.message, "code": call.problem.code}
    if isinstance(call.reply, GotoResponse):
        return {"accepted": call.reply.accepted, "reason": call.reply.reason}
    if isinstance(call.reply, SetParamsResponse):
        reason = call.reply.reason.removeprefix("param set: ")
        return {"accepted": call.reply.success, "reason": reason}
    if isinstance(call.reply, dict):
        refused = False in (call.reply.get("accepted"), call.reply.get("success"))
        reason = str(call.reply.get("reason", ""))
        return {"accepted": not refused, "reason": reason, "reply": call.reply}
    more = {"baseline": call.reply.baseline} if isinstance(call.reply, CalibrateResponse) else {}
    return {"accepted": True, "reason": ""} | more


def _text(outcome: dict[str, Any]) -> str:
    if not outcome["accepted"]:
        return f"rejected: {outcome['reason']}"
    if outcome["reason"]:
        return f"accepted, {outcome['reason']}"
    if outcome.get("reply"):
        filled = {name: value for name, value in outcome["reply"].items() if value != ""}
        return ", ".join(f"{name} {catalogue.word(value)}" for name, value in filled.items())
    return f"baseline {outcome['baseline']:.4f} hPa" if "baseline" in outcome else "accepted"
