"""Height and pressure over the last minute, and what may be wrong with the barometer."""

from typing import TYPE_CHECKING, Any

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from cli.console.board import Glance, Sample
from cli.console.panels.card import card, read
from cli.console.parts import Plot
from cli.console.settings import tables

if TYPE_CHECKING:
    from cli.console.page import Page

_FAULT = "pressure.fault.kind"
_FIELDS = Sample._fields[1:]


class Readings:
    """Two plots; a fault is a parameter, set here by a click."""

    def __init__(self, page: "Page") -> None:
        self._page = page
        every = {setting.name: setting for table in tables({}) for setting in table.settings}
        self._setting = every[_FAULT]
        kinds = sorted(self._setting.choices, key=lambda kind: kind != "none")
        with card("Readings", "readings"):
            Plot(_FIELDS.index("z"), "height", "height", least=1.0)
            baseline = _FIELDS.index("baseline")
            Plot(_FIELDS.index("pressure"), "pressure", "pressure", least=2e-4, since=baseline)
            with ui.element("dl"):
                ui.html("baseline", sanitize=False, tag="dt")
                read("baseline", tag="dd")
                ui.html("sensor fault", sanitize=False, tag="dt")
                self._kinds = ui.toggle(kinds, value="none").props("no-caps unelevated dense")
        self._kinds.classes("faults").on_value_change(self._set)
        self._kinds.set_enabled(page.control)
        self._shown = "none"

    def refresh(self, now: Glance) -> None:
        """Show which fault there is."""
        kind = now.values.get(_FAULT, self._shown)
        if kind != self._shown:
            self._shown = kind
            self._kinds.value = kind

    async def _set(self, event: ValueChangeEventArguments[Any]) -> None:
        kind = str(event.value)
        if kind == self._shown:
            return  # it has followed the parameter, not a finger
        before, self._shown = self._shown, kind
        if not await self._page.do(lambda: self._page.acts.change(self._setting, kind)):
            self._shown = before
            self._kinds.value = before
