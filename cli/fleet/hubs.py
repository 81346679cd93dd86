"""The hubs of a fleet: asked at the same time, so that one that is away holds up none of the others."""

import threading
import time
from collections.abc import Callable, Collection
from concurrent.futures import Future
from typing import Self, TypeVar

from msgspec import structs

from cli import bus
from cli.fleet.file import Member
from cli.options import Options
from cli.together import Heard, ask_each
from services.runtime.bus.client import Client
from services.runtime.errors import TimedOut

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
                found.set_result(bus.connect(options))
            except BaseException as problem:
                found.set_exception(problem)
                raise
        try:
            shared = found.result(max(ends - time.monotonic(), 0))
        except TimeoutError as error:
            raise late(connect, timeout) from error
        return shared.beside(vehicle, max(round(ends - time.monotonic(), 2), 0.01))

    def ask(
        self,
        members: Collection[Member],
        do: Callable[[Member, Client], T],
        *,
        bounded: bool,
        all_or_none: bool = False,
    ) -> Heard[T]:
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


def late(connect: str, timeout: float) -> TimedOut:
    """What is known of a hub that lets nobody in."""
    return TimedOut(
        f"{connect or 'the hub'} did not answer within {timeout:g} s",
        "is its machine there, is its process frozen, does the network let you through?",
    )
