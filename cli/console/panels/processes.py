"""The processes of the run, each with a button that starts it anew."""

from functools import partial
from typing import TYPE_CHECKING

from nicegui import ui

from cli.console.board import Glance
from cli.console.panels.card import card
from services.runtime.run_files import ProcessRecord

if TYPE_CHECKING:
    from cli.console.page import Page


class Processes:
    """Written anew when one of them has changed."""

    def __init__(self, page: "Page") -> None:
        self._page = page
        self._shown: tuple[ProcessRecord, ...] = ()
        with card("Processes", "processes"):
            self._rows = ui.element("div").classes("rows")
            if page.link.realm is None:
                ui.html("They run on another machine.", sanitize=False, tag="p").classes("rows")

    def refresh(self, now: Glance) -> None:
        """Show them as they are."""
        if now.nodes == self._shown:
            return
        self._shown = now.nodes
        self._rows.clear()
        with self._rows:
            for node in now.nodes:
                self._row(node)

    def _row(self, node: ProcessRecord) -> None:
        with ui.element("div").classes(f"row-of {node.state}").props(f"data-node={node.name}"):
            ui.html(node.name, sanitize=True, tag="b")
            ui.html(node.state, sanitize=False, tag="span").classes("how")
            ui.html(f"pid {node.pid or '-'}", sanitize=False, tag="span").classes("pid")
            times = f"{node.restarts} restarts" if node.restarts else ""
            ui.html(times, sanitize=False, tag="span").classes("times")
            again = ui.button("Restart", on_click=partial(self._restart, node.name), color=None)
            again.props("no-caps flat dense").set_enabled(self._page.control)

    async def _restart(self, name: str) -> None:
        await self._page.do(lambda: self._page.acts.restart(name))
