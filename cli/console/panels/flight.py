"""The scene, and where to fly next: by a click on the floor, or by the keys."""

import math
from typing import TYPE_CHECKING, Any

from nicegui import ui
from nicegui.events import GenericEventArguments, ValueChangeEventArguments

from cli.console.aim import clicked, stepped
from cli.console.board import Glance
from cli.console.panels.card import read
from cli.console.parts import Scene, floor_point
from schemas.messages import Position

if TYPE_CHECKING:
    from cli.console.page import Page

_HEIGHT, _CEILING = 1.0, 5.0
_KEYS = "Click the floor to go there, or arrow keys and <kbd>PgUp</kbd> <kbd>PgDn</kbd> to aim by a metre and <kbd>Enter</kbd> to send."
_WATCHING = "Drag to turn the view, scroll to come nearer."


class Flight:
    """The biggest part of the page."""

    def __init__(self, page: "Page") -> None:
        self._page = page
        with ui.element("section").classes("card flight"):
            self._scene = Scene(_HEIGHT, control=page.control)
            with ui.element("div").classes("readout"):
                for axis in "xyz":
                    with ui.element("div"):
                        ui.html(axis, sanitize=False, tag="label")
                        read(axis)
                with ui.element("div").classes("small"):
                    read("speed")
                    read("time")
            with ui.element("div").classes("bar"):
                if page.control:
                    self._aims()
                ui.html(_KEYS if page.control else _WATCHING, sanitize=False, tag="p")
                read("target", tag="p", classes="target")
        if page.control:
            self._scene.on("floor", self._click)
            self._scene.on("step", self._step)
            self._scene.on("send", self._send)
            self._scene.on("drop", self._drop)

    def _aims(self) -> None:
        with ui.element("div").classes("height"):
            ui.html("height", sanitize=False, tag="label")
            self._slider = ui.slider(min=0, max=_CEILING, step=0.1, value=_HEIGHT)
            self._slider.props("aria-label=height").on_value_change(self._raise)
            self._metres = ui.html(f"{_HEIGHT:.1f} m", sanitize=False, tag="output")
        self._replace = ui.checkbox("change course in flight").props("dense")

    def refresh(self, now: Glance) -> None:
        """Let the slider reach half as high again as the cage, for the refusal is worth seeing."""
        if self._page.control and now.state is not None:
            most = math.ceil(now.state.cage.z * 1.5)
            if self._slider.props["max"] != most:
                self._slider.props["max"] = most
                self._slider.update()

    def _raise(self, event: ValueChangeEventArguments[Any]) -> None:
        self._metres.content = f"{float(event.value):.1f} m"
        self._scene.raise_to(float(event.value))

    async def _click(self, event: GenericEventArguments) -> None:
        await self._go(clicked(*floor_point(event), float(self._slider.value)))

    def _step(self, event: GenericEventArguments) -> None:
        key, before = str(event.args), self._page.target
        self._page.target = self._page.link.see(lambda board: stepped(board, before, key))

    async def _send(self) -> None:
        if (goal := self._page.target) is not None:
            self._page.target = None
            await self._go(goal)

    def _drop(self) -> None:
        self._page.target = None

    async def _go(self, goal: Position) -> None:
        replace = bool(self._replace.value)
        await self._page.do(lambda: self._page.acts.goto(goal, replace=replace))
