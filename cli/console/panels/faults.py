"""Faults to order: a button each, lit while the fault is in."""

from functools import partial
from typing import TYPE_CHECKING

from nicegui import ui

from cli.console.board import Glance
from cli.console.panels.card import card
from cli.console.settings import tables
from cli.fault.catalogue import FAULTS, Fault, active

if TYPE_CHECKING:
    from cli.console.page import Page


class Faults:
    """Each is a parameter, as for `quadctl fault`: a click puts it in, or takes it out."""

    def __init__(self, page: "Page") -> None:
        self._page = page
        self._settings = {each.name: each for table in tables({}) for each in table.settings}
        self._buttons: dict[str, ui.button] = {}
        self._shown: frozenset[str] = frozenset()
        with card("Faults", "faults"), ui.element("div").classes("switches"):
            for fault in FAULTS:
                made = ui.button(fault.name, on_click=partial(self._turn, fault), color=None)
                made.props(f'no-caps flat dense data-fault={fault.name} title="{fault.about}"')
                made.props("aria-pressed=false").set_enabled(page.control)
                self._buttons[fault.name] = made

    def refresh(self, now: Glance) -> None:
        """Light those that are in."""
        there = frozenset(active(now.values))
        for name in there ^ self._shown:
            button = self._buttons[name].props(f"aria-pressed={str(name in there).lower()}")
            button.classes(add="in") if name in there else button.classes(remove="in")
        self._shown = there

    async def _turn(self, fault: Fault) -> None:
        value = fault.sound if fault.name in self._shown else fault.value
        setting = self._settings[fault.parameter]
        await self._page.do(lambda: self._page.acts.change(setting, value))
