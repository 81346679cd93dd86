"""The automaton, and what an operator has at hand: cage, hold, calibrate, reset."""

from typing import TYPE_CHECKING, Any

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from cli.console.automaton import drawing
from cli.console.board import Glance
from cli.console.panels.card import card, read

if TYPE_CHECKING:
    from cli.console.page import Page


class Safety:
    """The first thing to look at beside the vehicle."""

    def __init__(self, page: "Page") -> None:
        self._page, self._busy = page, False
        acts = page.acts
        with card("Safety", "safety"):
            ui.html(drawing(), sanitize=False)
            read("reason", tag="p", classes="reason").props("role=status")
            with ui.element("dl"):
                for name in ("goal", "cage"):
                    ui.html(name, sanitize=False, tag="dt")
                    read(name, tag="dd")
            with ui.element("div").classes("buttons"):
                self._cage = ui.switch("cage").on_value_change(self._toggle)
                self._cage.set_enabled(page.control)
                for text, act in (
                    ("Hold", acts.hold),
                    ("Calibrate", lambda: acts.calibrate(zero=True)),
                    ("Reset", acts.reset),
                ):
                    made = ui.button(text, on_click=lambda act=act: page.do(act), color=None)
                    made.props("no-caps unelevated").classes(f"act {text.lower()}")
                    made.set_enabled(page.control)

    def refresh(self, now: Glance) -> None:
        """Show the switch as the cage is."""
        if now.state is not None and not self._busy:
            self._cage.value = now.state.cage_on

    async def _toggle(self, event: ValueChangeEventArguments[Any]) -> None:
        on, state = bool(event.value), self._page.link.see(lambda board: board.state)
        if self._busy or state is None or on == state.cage_on:
            return  # the switch has followed the cage, not a finger
        self._busy = True
        try:
            await self._page.do(lambda: self._page.acts.cage(on=on))
        finally:
            self._busy = False
