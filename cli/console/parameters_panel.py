"""The parameter panel: one table at a time, with editable values, bounds and meanings."""

from functools import partial
from typing import Any

from nicegui import ui

from quadctl.cli.console.actions import PageContext
from quadctl.cli.console.elements import card
from quadctl.cli.console.model import Glance
from quadctl.cli.console.settings import Setting, shown, tables

Field = ui.switch | ui.select | ui.input

_FIRST = "safety"


class ParametersPanel:
    """Parameters, one table at a time; a value is set as soon as it is entered."""

    def __init__(self, page: PageContext) -> None:
        self._page = page
        every = tables(page.link.see(lambda board: dict(board.values)))
        self._tables = {table.name: table for table in every}
        self._fields: dict[str, tuple[Setting, Field]] = {}
        self._last: dict[str, Any] = {}  # value of each field as last shown
        self._busy: set[str] = set()
        with card("Parameters", "parameters"):
            choice = ui.tabs().props("no-caps dense align=left outside-arrows")
            with choice:
                for name in self._tables:
                    ui.tab(name)
            choice.value = _FIRST
            choice.on_value_change(lambda event: self._show(str(event.value)))
            self._rows = ui.element("div").classes("rows")
        self._show(_FIRST)

    def refresh(self, now: Glance) -> None:
        """Show values that have changed, from any client."""
        for name, (setting, field) in self._fields.items():
            value = now.values.get(name)
            if name in now.values and name not in self._busy and self._last.get(name, ...) != value:
                self._last[name] = value
                field.set_enabled(self._page.control and not setting.fixed)
                field.value = value if setting.way != "text" else shown(value)

    def _show(self, name: str) -> None:
        table = self._tables.get(name)
        if table is None:
            return  # not one of the tabs: a browser may send anything
        self._fields.clear()
        self._last.clear()
        self._rows.clear()
        with self._rows:
            ui.html(table.about, sanitize=True, tag="p")
            for setting in table.settings:
                self._row(setting)

    def _row(self, setting: Setting) -> None:
        with ui.element("div").classes("row-of").props(f'data-param="{setting.name}"'):
            ui.html(setting.label, sanitize=True, tag="label")
            field = self._field(setting)
            field.props(f'aria-label="{setting.name}"').classes("field")
            field.set_enabled(False)  # until its value is known
            ui.html(setting.facts, sanitize=True, tag="span").classes("facts")
            ui.html(setting.about, sanitize=True, tag="span").classes("about")
        self._fields[setting.name] = setting, field

    def _field(self, setting: Setting) -> Field:
        commit = partial(self._commit, setting)
        if setting.way == "switch":
            return ui.switch(value=None).on_value_change(commit)
        if setting.way == "choice":
            chosen = ui.select(list(setting.choices), value=None)
            return chosen.props("dense outlined options-dense").on_value_change(commit)
        field = ui.input().props("dense outlined")
        field.on("keydown.enter", commit)
        field.on("blur", commit)
        return field

    async def _commit(self, setting: Setting) -> None:
        _, field = self._fields.get(setting.name, (None, None))
        if field is None or setting.name in self._busy:
            return
        entered, before = field.value, self._last.get(setting.name)
        if setting.way == "text" and setting.name in self._last:
            before = shown(before)
        if entered == before or (setting.way == "text" and not entered):
            return  # unchanged, or set by `refresh` and not by the user
        self._busy.add(setting.name)
        if not await self._page.do(lambda: self._page.acts.change(setting, entered)):
            field.value = before
        self._busy.discard(setting.name)
