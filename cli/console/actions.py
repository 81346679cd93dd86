"""The actions of a page: the same calls as the commands of those names."""

from collections.abc import Callable
from typing import Any, Protocol

import msgspec

from quadctl.cli.console.bus_link import Link
from quadctl.cli.console.model import Board
from quadctl.cli.console.settings import Setting, shown
from quadctl.schemas.messages import Position
from quadctl.schemas.services import (
    CalibrateRequest,
    GetParamsRequest,
    GotoRequest,
    HoldRequest,
    ResetRequest,
    SetParamsRequest,
    ToggleCageRequest,
)
from quadctl.schemas.topics import CALIBRATE, GOTO, HOLD, RESET, TOGGLE_CAGE, get_params, set_params
from quadctl.services.runtime.errors import Invalid, Refused, Unreachable
from quadctl.services.runtime.supervisor.control import request_restart, wait_restarted

Act = Callable[[], str]
"""Blocks until it is done, for no longer than the timeout; returns what to tell, or raises."""


_PATIENCE = 5.0
"""Seconds for a process to be ready again."""


class Acts:
    """Everything that changes something, each as a function to be run on a thread."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def goto(self, goal: Position, *, replace: bool) -> str:
        """Ask safety for a goal; raises Refused with its reason."""
        asked = {"x": goal.x, "y": goal.y, "z": goal.z, "replace": replace}
        try:
            request = msgspec.convert(asked, GotoRequest)
        except msgspec.ValidationError as error:
            raise Invalid(f"no place to fly to: {error}") from error
        reply = self._link.client.call(GOTO, request)
        if not reply.accepted:
            self._link.see(lambda board: board.refuse(goal))
            raise Refused(reply.reason)
        return ""

    def cage(self, *, on: bool) -> str:
        """Turn the cage on or off."""
        self._link.client.call(TOGGLE_CAGE, ToggleCageRequest(on))
        return ""

    def calibrate(self, *, zero: bool) -> str:
        """Zero the barometer, or undo it."""
        baseline = self._link.client.call(CALIBRATE, CalibrateRequest(zero)).baseline
        text = f"baseline {baseline:.4f} hPa" if zero else "baseline dropped"
        self._link.see(lambda board: board.note(_now(board), "pressure", text))
        return text

    def hold(self) -> str:
        """Stop and hover."""
        self._link.client.call(HOLD, HoldRequest())
        return ""

    def reset(self) -> str:
        """Put the vehicle back at its start."""
        self._link.client.call(RESET, ResetRequest())
        return ""

    def change(self, setting: Setting, said: Any) -> str:
        """Set a parameter of the running node."""
        value = setting.read(said)
        node = setting.name.partition(".")[0]
        client = self._link.client
        reply = client.call(set_params(node), SetParamsRequest({setting.name: value}))
        if not reply.success:
            raise Invalid(reply.reason, "nothing was changed")
        # As the node has it: of 4 it makes 4.0.
        now = client.call(get_params(node), GetParamsRequest([setting.name])).values
        text = f"{setting.name} = {shown(now[setting.name])}"

        def take(board: Board) -> None:
            board.values |= now
            board.note(_now(board), "setting", text)

        self._link.see(take)
        return text

    def restart(self, name: str) -> str:
        """Have the supervisor start a process anew, and wait until it is ready."""
        realm = self._link.realm
        if realm is None:
            raise Unreachable(
                "processes of another machine cannot be restarted from here",
                f"there: `quadctl node restart {name}`",
            )
        before = request_restart(realm, name)
        # The hub's takes every connection with it, so that only the folder can be asked.
        after = wait_restarted(realm, name, before, _PATIENCE)
        text = f"{name}: process {after.pid} in place of {before.pid or 'none'}"
        self._link.see(lambda board: board.note(_now(board), "process", text))
        return text


def _now(board: Board) -> float:
    return board.pose.stamp if board.pose else 0.0


class PageContext(Protocol):
    """A page as its panels see it: the bus behind it, what it may do, and the point chosen on it."""

    link: Link
    vehicles: list[str]
    control: bool
    acts: Acts
    target: Position | None

    async def do(self, act: Act) -> bool:
        """Carry an action out on a thread and show its result; returns whether it succeeded."""
