"""Connections to several hubs, the members of the fleet, and one exit code for all of them."""

import os
import re
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from msgspec import structs

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.cli.fleet import file as fleet_file
from quadctl.cli.fleet.file import FleetFile, Member
from quadctl.services.runtime import realm
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.concurrent import Answers, ask_each
from quadctl.services.runtime.errors import QuadctlError, TimedOut, Unreachable, UsageError
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.vehicles import in_run, vehicles_of

T = TypeVar("T")

_SLACK = 0.15  # s beyond the timeout for a late hub's own error
_CLOSING = 0.1  # s to close the connections; a hub that is away is not waited for


class Hubs:
    """One connection per hub, made at its first use."""

    def __init__(self, options: Options) -> None:
        self._options, self._lock = options, threading.Lock()
        self._found: dict[str, Future[Client]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        made = {
            connect: found.result()
            for connect, found in self._found.items()
            if found.done() and found.exception() is None
        }
        ask_each(made, lambda connect: made[connect].__exit__(), within=_CLOSING)

    def client(self, connect: str, vehicle: str, timeout: float) -> Client:
        """Return a vehicle's client with the rest of the timeout (s); raise as context.connect."""
        ends = time.monotonic() + timeout
        options = structs.replace(self._options, connect=connect, named=vehicle, timeout=timeout)
        with self._lock:
            if connect not in self._found:
                self._found[connect] = _in_background(lambda: context.connect(options))
        try:
            shared = self._found[connect].result(max(ends + _SLACK - time.monotonic(), 0))
        except TimeoutError as error:
            raise TimedOut(
                f"{connect or 'the hub'} did not answer within {timeout:g} s",
                "check that its machine is up, its process not frozen, and the network not blocked",
            ) from error
        return shared.beside(vehicle, max(round(ends - time.monotonic(), 2), 0.01))

    def ask(
        self,
        members: Collection[Member],
        do: Callable[[Member, Client], T],
        *,
        all_or_none: bool = False,
    ) -> Answers[T]:
        """Call `do` for all members at once, each on its own thread; return the results by name.

        A client's timeout is the rest of --timeout. With `all_or_none`, nothing is awaited after the
        first failure.
        """
        by_name = {member.name: member for member in members}
        timeout = self._options.timeout

        def one(name: str) -> T:
            member = by_name[name]
            return do(member, self.client(member.connect, member.vehicle, timeout))

        return ask_each(by_name, one, all_or_none=all_or_none)


def _in_background(make: Callable[[], T]) -> Future[T]:
    """Return the result to come of a call on a thread: nobody has to wait for it."""
    result: Future[T] = Future()

    def run() -> None:
        try:
            result.set_result(make())
        except BaseException as problem:  # noqa: BLE001 - raised again for each that asks
            result.set_exception(problem)

    threading.Thread(target=run, daemon=True).start()
    return result


File = Annotated[
    Path | None, Option("The fleet's file (default: ./fleet.toml if it exists).", ("--fleet",))
]


def fleet_of(options: Options, file: Path | None, hubs: Hubs) -> FleetFile:
    """Return the fleet of a file, else all vehicles of the hub; raise Invalid or Unreachable."""
    # QUADCTL_VEHICLE, set for a whole shell, must not limit a fleet command to one vehicle.
    if options.named and options.named != os.environ.get("QUADCTL_VEHICLE"):
        raise UsageError(
            f"--vehicle {options.named}: a fleet command is for the whole fleet",
            "leave out `fleet` for one vehicle, or name several in a file for --fleet",
        )
    if file is None and not fleet_file.DEFAULT.exists():
        return FleetFile(_on_the_hub(options, hubs), {})
    fleet = fleet_file.read(file or fleet_file.DEFAULT, options.connect)
    if file is None and not options.json and (left := left_out(options, fleet)):
        be = "is" if len(left) == 1 else "are"
        output.note(
            f"from {fleet.source}; {realm.listed(left)}, which {be} live on this hub, {be} not in it"
        )
    return fleet


def left_out(options: Options, fleet: FleetFile) -> list[str]:
    """Return the vehicles of the realm's run, if there is one, that are not in the fleet."""
    if options.connect:
        return []
    ours = ("", Realm(options.realm).endpoint)
    named = {member.vehicle for member in fleet.members if member.connect in ours}
    return [name for name in in_run(options.realm) if name not in named]


def _on_the_hub(options: Options, hubs: Hubs) -> list[Member]:
    names = set(vehicles_of(options.realm, options.connect, options.timeout))
    if not options.connect:
        # The run's record has vehicles with dead processes, but none that joined from elsewhere.
        any_ = next(iter(names), realm.DEFAULT)
        names |= set(hubs.client("", any_, options.timeout).vehicles())
    if not names:
        raise Unreachable("no vehicle is on the hub", "`quadctl up` starts one")
    return [Member(name, options.connect, name) for name in sorted(names, key=_in_order)]


def _in_order(name: str) -> list[tuple[int, str]]:
    """Return a sort key that puts `uav10` after `uav9`."""
    return [(int(part or 0), text) for text, part in re.findall(r"(\D*)(\d*)", name)]


_WORST_LAST = (5, 6, 7, 4, 3, 1)
"""Exit codes by gravity: a vehicle that refuses is known to work, a silent one is not."""


def fail(problems: Mapping[str, QuadctlError]) -> None:
    """Raise the worst vehicle's problem, if any, with the others' attached."""
    if not problems:
        return
    *others, worst = sorted(problems.items(), key=lambda item: _gravity(item[1]))
    name, problem = worst
    whole = type(problem)(f"{name}: {problem.message}", problem.hint)
    whole.others = [f"{other}: {less.message}" for other, less in others]
    raise whole


def no_vehicle_sent(problems: Mapping[str, QuadctlError], names: Sequence[str]) -> QuadctlError:
    """Return the error for a centre if the places of some vehicles are unknown."""
    worst = max(problems.values(), key=_gravity)
    reasons = "; ".join(f"{name}: {problem.message}" for name, problem in problems.items())
    known = next((name for name in names if name not in problems), "")
    return type(worst)(
        f"no vehicle was sent: the formation's centre needs all; {reasons}",
        f"name the vehicles to send: `quadctl fleet goto {known}=1,2,1`" if known else worst.hint,
    )


def row(member: Member, options: Options, problem: QuadctlError | None, **more: Any) -> Any:
    """Return a vehicle's part of the JSON document."""
    error = None
    if problem is not None:
        error = {"code": problem.code, "message": problem.message, "hint": problem.hint}
    return {"vehicle": member.name, "hub": hub_of(member, options), **more, "error": error}


def print_results(
    options: Options,
    rows: list[Any],
    texts: Mapping[str, str],
    problems: Mapping[str, QuadctlError],
) -> None:
    """Print the rows with --json, else a line for each vehicle; raise as `fail`."""
    if options.json:
        output.document(rows)
    else:
        for name, text in texts.items():
            output.line(f"{name}: {text}")
    fail(problems)


def hub_of(member: Member, options: Options) -> str:
    """Return the endpoint of a member's hub, or the realm."""
    return member.connect or f"realm {options.realm}"


def _gravity(problem: QuadctlError) -> int:
    code = problem.exit_code
    return _WORST_LAST.index(code) if code in _WORST_LAST else len(_WORST_LAST)
