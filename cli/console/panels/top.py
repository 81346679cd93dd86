"""The bar at the top: whose page this is, and how it stands with the run."""

from typing import TYPE_CHECKING
from urllib.parse import urlencode

from nicegui import ui

from cli.console.panels.card import read

if TYPE_CHECKING:
    from cli.console.page import Page


def top(page: "Page") -> None:
    """Make the bar, and the banner below it that shows while something is wrong."""
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
        read("link", classes="link").props("role=status")
    with ui.element("div").classes("banner").props("role=alert"):
        read("problem")


def _go_to(vehicle: str) -> None:
    asked = dict(ui.context.client.request.query_params) | {"vehicle": vehicle}
    ui.navigate.to(f"/?{urlencode(asked)}")
