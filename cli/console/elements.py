"""Cards, readouts and the Vue components in assets/."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from nicegui import ui
from nicegui.awaitable_response import AwaitableResponse
from nicegui.events import GenericEventArguments

from quadctl.cli.console.model import STEPS


@contextmanager
def card(title: str, name: str = "") -> Iterator[ui.element]:
    """What is made within stands on it; `name` is its class."""
    with ui.element("section").classes(f"card {name}") as made:
        with ui.element("header"):
            ui.html(title, sanitize=False, tag="h2")
        yield made


def read(name: str, tag: str = "span", classes: str = "") -> ui.html:
    """A text that each picture brings by this name; see `frame.readouts`."""
    return ui.html("", sanitize=False, tag=tag).props(f"data-read={name}").classes(classes)


# Brings three.js, which the scene below draws with, onto the page.
_THREE = ui.scene


class Live(ui.element, component="assets/live.js"):
    """Takes the pictures that the server sends, and hands them to all that shows them."""

    def show(self, frame: dict[str, Any], timeout: float) -> AwaitableResponse:
        """Send one; awaited, it is the number of the sample up to which the browser has it now."""
        return self.run_method("show", frame, timeout=timeout)


class SceneView(
    ui.element, component="assets/airspace.js", esm={"quadctl-shapes": "assets/shapes"}
):
    """The vehicle in its cage. Events: `floor` with x and y, `step` with a key, `send`."""

    def __init__(self, height: float, *, control: bool) -> None:
        """`height` (m) is that of the ghost over the floor; without `control` there is none."""
        super().__init__()
        self._props["control"] = control
        self._props["keys"] = list(STEPS)
        self.raise_to(height)

    def raise_to(self, height: float) -> None:
        """Show the ghost at a height, m."""
        self._props["height"] = height
        self.update()


class Plot(ui.element, component="assets/plot.js"):
    """The last minute of one value: `field` is its place in a sample."""

    def __init__(self, field: int, title: str, read: str, *, least: float, since: int = -1) -> None:
        """`read` names the text beside the title, `least` is the smallest range that is shown.

        What was before a change of the field `since` is left out.
        """
        super().__init__()
        self._props |= {"field": field, "title": title, "read": read}
        self._props |= {"since": since, "least": least}


def floor_point(event: GenericEventArguments) -> tuple[float, float]:
    """Where the floor was clicked, m; raises TypeError or ValueError for what is no point."""
    x, y = event.args["x"], event.args["y"]
    return float(x), float(y)
