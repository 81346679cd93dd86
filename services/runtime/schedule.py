"""Calls that wait for their simulated time. Pure: who keeps the clock says what it shows.

The clock is a boot of the simulation and a time in it. A call is made for the boot that is now or
for one that is yet to begin; once its boot is over it is never executed.
"""

from collections.abc import Callable
from math import inf
from typing import NamedTuple

from services.runtime.errors import Expired, NotReady, QuadctlError, Refused

MOST = 10_000
"""Calls that a node holds at a time."""


class Held(NamedTuple):
    """A call that waits.

    `at` is in simulated s of `boot`, `deadline` in Unix s. `settle` is called once: with None to
    execute and answer it, else with the reason why it will not be.
    """

    boot: str
    at: float
    deadline: float
    settle: Callable[[QuadctlError | None], None]


class Schedule:
    """The calls that one node holds, and the simulated time that it has seen."""

    def __init__(self) -> None:
        self._boot, self._stamp = "", 0.0
        self._held: list[Held] = []
        self._soonest = self._first_deadline = inf
        self.under_way = False
        """Whether a call waits for a time of the boot that is now."""
        self.holding = False
        """Whether any call waits."""

    @property
    def now(self) -> tuple[str, float]:
        """The boot and the time in it (simulated s) last seen; "" and 0 before the first."""
        return self._boot, self._stamp

    def hold(self, call: Held) -> None:
        """Let a call wait; one for boot "" is for the boot that is now.

        Raises NotReady, Expired or Refused where it cannot.
        """
        if not self._boot:
            raise NotReady(
                "no simulated time is known here",
                "is dynamics up? `quadctl status`; a node of your own calls `node.clock`",
            )
        call = call._replace(boot=call.boot or self._boot)
        if call.boot == self._boot and call.at <= self._stamp:
            raise Expired(f"the call was for {call.at:g} s, and it is {self._stamp:g} s already")
        if len(self._held) >= MOST:
            raise Refused(f"{MOST} calls are held already", "let some of them be executed first")
        self._keep([*self._held, call])

    def advance(self, boot: str, stamp: float, now: float) -> None:
        """It is `stamp` of `boot`, and `now` by Unix time: settle the calls whose time has come.

        They are settled in the order of their times, equal ones in the order of their arrival.
        """
        before, self._boot, self._stamp = self._boot, boot, stamp
        # Told of every pose, and nearly always there is nothing to do.
        if boot == before and stamp < self._soonest and now <= self._first_deadline:
            return
        due: list[Held] = []
        late: list[tuple[Held, str]] = []
        rest: list[Held] = []
        for call in self._held:
            if call.boot == before != boot:
                late.append((call, f"the call was for {call.at:g} s of a boot that is over"))
            elif call.deadline < now:
                late.append((call, "the deadline passed before the call's simulated time came"))
            elif call.boot == boot and call.at <= stamp:
                due.append(call)
            else:
                rest.append(call)
        self._keep(rest)
        for call, why in late:
            call.settle(Expired(why))
        for call in sorted(due, key=lambda call: call.at):
            call.settle(None)

    def _keep(self, calls: list[Held]) -> None:
        self._held, self.holding = calls, bool(calls)
        ours = [call.at for call in calls if call.boot == self._boot]
        self.under_way = bool(ours)
        self._soonest = min(ours, default=inf)
        self._first_deadline = min((call.deadline for call in calls), default=inf)
