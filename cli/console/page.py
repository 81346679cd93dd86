"""The layout of one page, and its feed of frames."""

import asyncio
import time
from pathlib import Path
from typing import Literal
from urllib.parse import urlencode

from nicegui import run, ui

from quadctl.cli.console import model
from quadctl.cli.console.actions import Act, Acts, PageContext
from quadctl.cli.console.bus_link import Link
from quadctl.cli.console.elements import Live, read
from quadctl.cli.console.model import TICK
from quadctl.cli.console.panels import (
    FaultsPanel,
    FlightPanel,
    ProcessesPanel,
    SafetyPanel,
    VerdictsPanel,
    readings,
)
from quadctl.cli.console.parameters_panel import ParametersPanel
from quadctl.schemas.messages import Position
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.terminal import escaped


def top(page: PageContext) -> None:
    """Make the bar and, below it, the banner for problems."""
    with ui.element("header").classes("top"):
        ui.html("quadctl<b>console</b>", sanitize=False, tag="h1")
        if len(page.vehicles) > 1:
            chosen = ui.select(page.vehicles, value=page.link.vehicle, label="vehicle")
            chosen.props("dense borderless").classes("vehicle")
            chosen.on_value_change(lambda event: _go_to(str(event.value)))
        else:
            ui.html(page.link.vehicle, sanitize=False, tag="span").classes("vehicle")
        if not page.control:
            ui.html("watching only", sanitize=False, tag="span").classes("badge")
        read("link", classes="link", text="connecting").props("role=status")
    with ui.element("div").classes("banner").props("role=alert"):
        read("problem")


def _go_to(vehicle: str) -> None:
    query = dict(ui.context.client.request.query_params) | {"vehicle": vehicle}
    ui.navigate.to(f"/?{urlencode(query)}")


_CSS = (Path(__file__).parent / "assets" / "console.css").read_text(encoding="utf-8")
_GONE = 60.0  # s without an answer after which a connected browser is given up

Kind = Literal["positive", "negative", "warning"]


class Page:
    """Page of one browser; without `control` it can only watch."""

    def __init__(self, link: Link, vehicles: list[str], *, control: bool) -> None:
        self.link, self.vehicles, self.control = link, vehicles, control
        self.acts = Acts(link)
        self.target: Position | None = None

    def build(self) -> None:
        """Lay the page out."""
        self._client = ui.context.client
        ui.add_css(_CSS)
        ui.colors(primary="#1f5fbf", positive="#1a7f37", negative="#b42318", warning="#9a6700")
        ui.context.client.content.classes(replace="page")
        self._live = Live()
        top(self)
        with ui.element("main").classes("grid"):
            flight = FlightPanel(self)
            with ui.element("div").classes("side"):
                safety = SafetyPanel(self)
                readings()
            with ui.element("div").classes("lower"):
                journal, processes = VerdictsPanel(), ProcessesPanel(self)
            faults, parameters = FaultsPanel(self), ParametersPanel(self)
        self._panels = (flight, safety, journal, processes, faults, parameters)
        self._refresh()

    def _refresh(self) -> None:
        now = self.link.see(lambda board: board.glance())
        for panel in self._panels:
            panel.refresh(now)

    async def do(self, act: Act) -> bool:
        """Run an action on a thread and show its result; every action goes through here."""
        if not self.control:
            self._notify("this page only watches: the address with the token controls", "warning")
            return False
        try:
            text = await run.io_bound(act)
        except QuadctlError as problem:
            self._notify(problem.message, "negative", problem.hint)
            return False
        if text:
            self._notify(text, "positive")
        return True

    def _notify(self, text: str, kind: Kind, hint: str = "") -> None:
        # By now the clicked element, or the whole page, may be gone.
        if not self._client.is_deleted:
            with self._client:
                ui.notify(escaped(text), type=kind, caption=escaped(hint) or None, timeout=6000)

    async def feed(self) -> None:
        """Send frames until the browser is gone.

        The next frame is made from the newest data once the browser has the previous one: a slow
        browser gets fewer frames and delays nothing else.
        """
        seen = model.NOTHING_SEEN
        while not self._client.is_deleted:
            began = time.monotonic()
            frame, after = self.link.see(lambda board: model.frame(board, seen, self.target))  # noqa: B023 - called at once
            try:
                got = await self._live.show(frame, timeout=_GONE)
            except TimeoutError:
                return
            if got == frame["seen"]:
                seen = after
            self._refresh()
            await asyncio.sleep(max(0.0, began + TICK - time.monotonic()))
