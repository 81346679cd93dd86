"""The panels of a page: flight, readings, safety, faults, processes and verdicts."""

import math
from functools import partial
from html import escape
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments, ValueChangeEventArguments

from quadctl.cli.console.actions import PageContext
from quadctl.cli.console.elements import Plot, SceneView, card, floor_point, read
from quadctl.cli.console.model import Glance, Sample, Verdict, clicked, drawing, stepped
from quadctl.cli.console.settings import tables
from quadctl.cli.fault.catalogue import FAULTS, Fault, active
from quadctl.schemas.messages import Position
from quadctl.services.runtime.run_files import ProcessRecord
from quadctl.services.runtime.terminal import escaped


class FaultsPanel:
    """Switches of the faults, the parameters of `quadctl fault`: a click injects or clears one."""

    def __init__(self, page: PageContext) -> None:
        self._page = page
        self._settings = {each.name: each for table in tables({}) for each in table.settings}
        self._buttons: dict[str, ui.button] = {}
        self._shown: frozenset[str] = frozenset()
        with card("Faults", "faults"), ui.element("div").classes("switches"):
            for fault in FAULTS:
                made = ui.button(fault.name, on_click=partial(self._toggle, fault), color=None)
                made.props(f'no-caps flat dense data-fault={fault.name} title="{fault.about}"')
                made.props("aria-pressed=false")
                self._buttons[fault.name] = made

    def refresh(self, now: Glance) -> None:
        """Light the active faults, once they are known."""
        for button in self._buttons.values():
            button.set_enabled(self._page.control and bool(now.values))
        injected = frozenset(active(now.values))
        for name in injected ^ self._shown:
            button = self._buttons[name].props(f"aria-pressed={str(name in injected).lower()}")
            button.classes(add="in") if name in injected else button.classes(remove="in")
        self._shown = injected

    async def _toggle(self, fault: Fault) -> None:
        value = fault.sound if fault.name in self._shown else fault.value
        setting = self._settings[fault.parameter]
        await self._page.do(lambda: self._page.acts.change(setting, value))


_NONE = '<li class="none">No requests yet.</li>'


class VerdictsPanel:
    """Log of the verdicts, rewritten after a new line."""

    def __init__(self) -> None:
        self._noted = 0
        with card("Verdicts", "journal"):
            self._list = ui.html(_NONE, sanitize=False, tag="ol").props("role=log")

    def refresh(self, now: Glance) -> None:
        """Show the lines, if there are new ones."""
        if now.noted != self._noted:
            self._noted = now.noted
            self._list.content = "".join(map(line, now.verdicts))


def line(verdict: Verdict) -> str:
    """Return a line as HTML, escaped: reasons come from a user's own nodes too."""
    return (
        f'<li class="{escape(verdict.kind)}"><time>{verdict.stamp:.1f} s</time>'
        f"<b>{escape(verdict.kind)}</b><span>{escape(escaped(verdict.text))}</span></li>"
    )


class ProcessesPanel:
    """Table of the processes, rewritten after a change."""

    def __init__(self, page: PageContext) -> None:
        self._page = page
        self._shown: tuple[ProcessRecord, ...] = ()
        with card("Processes", "processes"):
            self._rows = ui.element("div").classes("rows")
            if page.link.realm is None:
                ui.html("They run on another machine.", sanitize=False, tag="p").classes("rows")

    def refresh(self, now: Glance) -> None:
        """Show the processes, if one has changed."""
        if now.nodes == self._shown:
            return
        self._shown = now.nodes
        self._rows.clear()
        with self._rows:
            for node in now.nodes:
                self._row(node)

    def _row(self, node: ProcessRecord) -> None:
        page, restart = self._page, partial(self._page.acts.restart, node.name)
        with ui.element("div").classes(f"row-of {node.state}").props(f"data-node={node.name}"):
            ui.html(node.name, sanitize=True, tag="b")
            ui.html(node.state, sanitize=False, tag="span").classes("how")
            ui.html(f"pid {node.pid or '-'}", sanitize=False, tag="span").classes("pid")
            plural = "s" if node.restarts > 1 else ""
            times = f"{node.restarts} restart{plural}" if node.restarts else ""
            ui.html(times, sanitize=False, tag="span").classes("times")
            again = ui.button("Restart", on_click=lambda: page.do(restart), color=None)
            again.props("no-caps flat dense").set_enabled(page.control)


_FIELDS = Sample._fields[1:]


def readings() -> None:
    """Show two plots and the baseline."""
    with card("Readings", "readings"):
        Plot(_FIELDS.index("z"), "height", "height", least=1.0)
        baseline = _FIELDS.index("baseline")
        Plot(_FIELDS.index("pressure"), "pressure", "pressure", least=2e-4, since=baseline)
        with ui.element("dl"):
            ui.html("baseline", sanitize=False, tag="dt")
            read("baseline", tag="dd")


class SafetyPanel:
    """Automaton, reason, goal, nearest wall, cage and the buttons for safety."""

    def __init__(self, page: PageContext) -> None:
        self._page, self._busy = page, False
        acts = page.acts
        with card("Safety", "safety"):
            ui.html(drawing(), sanitize=False)
            read("reason", tag="p", classes="reason").props("role=status")
            with ui.element("dl"):
                ui.html("goal", sanitize=False, tag="dt")
                with ui.element("dd"):
                    read("goal")
                    read("leg", classes="leg")
                for name in ("nearest", "cage"):
                    ui.html(name, sanitize=False, tag="dt")
                    read(name, tag="dd")
            with ui.element("div").classes("buttons"):
                self._cage = ui.switch("cage", value=None).on_value_change(self._toggle)
                self._buttons: list[ui.switch | ui.button] = [self._cage]
                for text, act in (
                    ("Hold", acts.hold),
                    ("Calibrate", lambda: acts.calibrate(zero=True)),
                    ("Reset", acts.reset),
                ):
                    made = ui.button(text, on_click=lambda act=act: page.do(act), color=None)
                    made.props("no-caps unelevated").classes(f"act {text.lower()}")
                    self._buttons.append(made)

    def refresh(self, now: Glance) -> None:
        """Set the switch to the state of the cage, and enable the buttons, once it is known."""
        for button in self._buttons:
            button.set_enabled(self._page.control and now.state is not None)
        if now.state is not None and not self._busy:
            self._cage.value = now.state.cage_on

    async def _toggle(self, event: ValueChangeEventArguments[Any]) -> None:
        on, state = bool(event.value), self._page.link.see(lambda board: board.state)
        if self._busy or state is None or on == state.cage_on:
            return  # set by `refresh`, not by the user
        self._busy = True
        try:
            await self._page.do(lambda: self._page.acts.cage(on=on))
        finally:
            self._busy = False


_HEIGHT, _CEILING = 1.0, 5.0
_KEYS = "Click the floor to fly there, or aim in steps of 1 m with the arrow keys, <kbd>PgUp</kbd> and <kbd>PgDn</kbd>, and send with <kbd>Enter</kbd>."
_WATCHING = "Drag to turn the view, scroll to zoom."


class FlightPanel:
    """3-D scene with the position, the aim and its height."""

    def __init__(self, page: PageContext) -> None:
        self._page = page
        with ui.element("section").classes("card flight"):
            self._scene = SceneView(_HEIGHT, control=page.control)
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
                    self._aim_controls()
                ui.html(_KEYS if page.control else _WATCHING, sanitize=False, tag="p")
                read("target", tag="p", classes="target")
        if page.control:
            self._scene.on("floor", self._click)
            self._scene.on("step", self._step)
            self._scene.on("send", self._send)
            self._scene.on("drop", self._drop)

    def _aim_controls(self) -> None:
        with ui.element("div").classes("height"):
            ui.html("height", sanitize=False, tag="label")
            self._slider = ui.slider(min=0, max=_CEILING, step=0.1, value=_HEIGHT)
            self._slider.props("aria-label=height").on_value_change(self._raise)
            self._metres = ui.html(f"{_HEIGHT:.1f} m", sanitize=False, tag="output")
        self._replace = ui.checkbox("change course in flight").props("dense")

    def refresh(self, now: Glance) -> None:
        """Let the slider reach 1.5 times the cage's height: a refusal is worth seeing."""
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
