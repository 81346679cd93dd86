"""Connections to several hubs, the members of the fleet, and one verdict for all of them."""

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
from quadctl.cli.concurrent import Answers, ask_each
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.cli.fleet import file as fleet_file
from quadctl.cli.fleet.file import FleetFile, Member
from quadctl.services.runtime import realm
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import QuadctlError, TimedOut, Unreachable, UsageError
from quadctl.services.runtime.realm import Realm

T = TypeVar("T")

_SLACK = 0.15
"""Seconds beyond the timeout in which who is late may still say why."""
_FAREWELL = 0.1
"""Seconds for taking leave of the hubs; one that is away is not waited for."""


class Hubs:
    """One connection a hub, made by whoever first needs it."""

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
        ask_each(made, lambda connect: made[connect].__exit__(), within=_FAREWELL)

    def client(self, connect: str, vehicle: str, timeout: float) -> Client:
        """A vehicle's client, with what is left of the timeout (s); raises as bus.connect."""
        ends = time.monotonic() + timeout
        with self._lock:
            is_first = connect not in self._found
            found = self._found.setdefault(connect, Future())
        if is_first:
            options = structs.replace(
                self._options, connect=connect, named=vehicle, timeout=timeout
            )
            try:
                found.set_result(context.connect(options))
            except BaseException as problem:
                found.set_exception(problem)
                raise
        try:
            shared = found.result(max(ends - time.monotonic(), 0))
        except TimeoutError as error:
            raise TimedOut(
                f"{connect or 'the hub'} did not answer within {timeout:g} s",
                "is its machine there, is its process frozen, does the network let you through?",
            ) from error
        return shared.beside(vehicle, max(round(ends - time.monotonic(), 2), 0.01))

    def ask(
        self,
        members: Collection[Member],
        do: Callable[[Member, Client], T],
        *,
        bounded: bool,
        all_or_none: bool = False,
    ) -> Answers[T]:
        """Call `do` for all members at once, each on a thread of its own; by name what came of it.

        A client's timeout is what is left of --timeout. Where `bounded`, who has not answered
        then is not waited for; with `all_or_none`, nobody is once one has failed.
        """
        by_name = {member.name: member for member in members}
        timeout = self._options.timeout

        def one(name: str) -> T:
            member = by_name[name]
            return do(member, self.client(member.connect, member.vehicle, timeout))

        within = timeout + _SLACK if bounded else None
        return ask_each(by_name, one, within, all_or_none=all_or_none)


File = Annotated[
    Path | None, Option("The fleet's file (default: ./fleet.toml if it is there).", ("--fleet",))
]
"""The option that every command of the fleet has."""


def fleet_of(options: Options, file: Path | None, hubs: Hubs) -> FleetFile:
    """The fleet of a file; where there is none, all vehicles of the hub.

    Raises Invalid for what is wrong with the file, Unreachable where nobody is there.
    """
    _check_for_all(options)
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
    """The vehicles of the realm's run, if it has one, that are not in the fleet."""
    if options.connect:
        return []
    ours = ("", Realm(options.realm).endpoint)
    named = {member.vehicle for member in fleet.members if member.connect in ours}
    return [name for name in context.in_run(options.realm) if name not in named]


def _on_the_hub(options: Options, hubs: Hubs) -> list[Member]:
    names = set(context.vehicles_of(options.realm, options.connect, options.timeout))
    if not options.connect:
        # The run's record names those too whose processes are away, but nobody that came besides.
        any_ = next(iter(names), realm.DEFAULT)
        names |= set(hubs.client("", any_, options.timeout).vehicles())
    if not names:
        raise Unreachable("no vehicle is on the hub", "`quadctl up` starts one")
    return [Member(name, options.connect, name) for name in sorted(names, key=_in_order)]


def _in_order(name: str) -> list[tuple[int, str]]:
    """`uav10` after `uav9`."""
    return [(int(part or 0), text) for text, part in re.findall(r"(\D*)(\d*)", name)]


def _check_for_all(options: Options) -> None:
    # Set for a whole shell, it is no reason to stop one vehicle alone.
    if options.named and options.named != os.environ.get("QUADCTL_VEHICLE"):
        raise UsageError(
            f"--vehicle {options.named}: a command of the fleet is for all of it",
            "leave `fleet` out for one vehicle, or name those you mean in a file for --fleet",
        )


_WORST_LAST = (5, 6, 7, 4, 3, 1)
"""Exit codes: a vehicle that refuses is known to be well, one that does not answer is not."""


def fail(problems: Mapping[str, QuadctlError]) -> None:
    """Raise the worst vehicle's problem, where there is one, and the others' with it."""
    if not problems:
        return
    *others, worst = sorted(problems.items(), key=lambda item: _gravity(item[1]))
    name, problem = worst
    whole = type(problem)(f"{name}: {problem.message}", problem.hint)
    whole.others = [f"{other}: {less.message}" for other, less in others]
    raise whole


def nobody_sent(problems: Mapping[str, QuadctlError], names: Sequence[str]) -> QuadctlError:
    """Why a centre was no goal for any of the vehicles: of some, these, nobody knows the place."""
    worst = max(problems.values(), key=_gravity)
    said = "; ".join(f"{name}: {problem.message}" for name, problem in problems.items())
    there = next((name for name in names if name not in problems), "")
    return type(worst)(
        f"nobody was sent: the formation's centre needs all of them; {said}",
        f"name those you mean: `quadctl fleet goto {there}=1,2,1`" if there else worst.hint,
    )


def row(member: Member, options: Options, problem: QuadctlError | None, **more: Any) -> Any:
    """A vehicle's part of the document."""
    error = None
    if problem is not None:
        error = {"code": problem.code, "message": problem.message, "hint": problem.hint}
    return {"vehicle": member.name, "hub": hub_of(member, options), **more, "error": error}


def tell(
    options: Options,
    rows: list[Any],
    texts: Mapping[str, str],
    problems: Mapping[str, QuadctlError],
) -> None:
    """Print the rows where --json asks for them, a line for each vehicle otherwise; raise as `fail`."""
    if options.json:
        output.document(rows)
    else:
        for name, text in texts.items():
            output.line(f"{name}: {text}")
    fail(problems)


def hub_of(member: Member, options: Options) -> str:
    """Its hub's endpoint, or the realm."""
    return member.connect or f"realm {options.realm}"


def _gravity(problem: QuadctlError) -> int:
    code = problem.exit_code
    return _WORST_LAST.index(code) if code in _WORST_LAST else len(_WORST_LAST)
