"""Actions of a page: the same calls as the commands of the same names."""

from collections.abc import Callable
from typing import Any, Protocol

from quadctl.cli.console.bus_link import Link
from quadctl.cli.console.model import Board
from quadctl.cli.console.settings import Setting, shown
from quadctl.schemas.messages import Position
from quadctl.schemas.services import (
    CalibrateRequest,
    GetParamsRequest,
    HoldRequest,
    ResetRequest,
    SetParamsRequest,
    ToggleCageRequest,
)
from quadctl.schemas.topics import CALIBRATE, GOTO, HOLD, RESET, TOGGLE_CAGE, get_params, set_params
from quadctl.services.runtime.errors import Invalid, Refused, Unreachable
from quadctl.services.runtime.supervisor.control import request_restart, wait_restarted
from quadctl.vehicle import goal_of

Act = Callable[[], str]
"""Blocking action, no longer than the timeout; returns the text to show, or raises."""
_PATIENCE = 5.0  # s for a process to be ready again


class Acts:
    """Everything that changes something, as functions to run on a thread."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def goto(self, goal: Position, *, replace: bool) -> str:
        """Request a goal; raise Refused with the reason if safety rejects it."""
        request = goal_of(goal.x, goal.y, goal.z, replace=replace)
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
        """Zero the barometer, or drop its baseline."""
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

    def change(self, setting: Setting, entered: Any) -> str:
        """Set a parameter of the running node."""
        value = setting.read(entered)
        node = setting.name.partition(".")[0]
        client = self._link.client
        reply = client.call(set_params(node), SetParamsRequest({setting.name: value}))
        if not reply.success:
            raise Invalid(reply.reason, "nothing was changed")
        # Show the value that the node has stored: it turns 4 into 4.0.
        now = client.call(get_params(node), GetParamsRequest([setting.name])).values
        text = f"{setting.name} = {shown(now[setting.name])}"

        def take(board: Board) -> None:
            board.values |= now
            board.note(_now(board), "setting", text)

        self._link.see(take)
        return text

    def restart(self, name: str) -> str:
        """Have the supervisor restart a process, and wait until it is ready."""
        realm = self._link.realm
        if realm is None:
            raise Unreachable(
                "processes of another machine cannot be restarted from here",
                f"run `quadctl node restart {name}` there",
            )
        before = request_restart(realm, name)
        # A restart of the hub cuts every connection, so only the folder can show the result.
        after = wait_restarted(realm, name, before, _PATIENCE)
        text = f"{name}: process {after.pid} in place of {before.pid or 'none'}"
        self._link.see(lambda board: board.note(_now(board), "process", text))
        return text


def _now(board: Board) -> float:
    return board.pose.stamp if board.pose else 0.0


class PageContext(Protocol):
    """Page as its panels see it: its link to the bus, its permission, and the chosen point."""

    link: Link
    vehicles: list[str]
    control: bool
    acts: Acts
    target: Position | None

    async def do(self, act: Act) -> bool:
        """Run an action on a thread and show its result; return whether it succeeded."""
