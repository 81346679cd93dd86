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
    """Open a card for the elements made in the block; `name` is its CSS class."""
    with ui.element("section").classes(f"card {name}") as made:
        with ui.element("header"):
            ui.html(title, sanitize=False, tag="h2")
        yield made


def read(name: str, tag: str = "span", classes: str = "", text: str = "") -> ui.html:
    """Return a text that each frame updates by this name; see `model.readouts`."""
    return ui.html(text, sanitize=False, tag=tag).props(f"data-read={name}").classes(classes)


# Loads three.js into the page, for the scene below.
_THREE = ui.scene


class Live(ui.element, component="assets/live.js"):
    """Receiver of the frames; passes them to the scene, the plots and the texts."""

    def show(self, frame: dict[str, Any], timeout: float) -> AwaitableResponse:
        """Send a frame; await the number of the newest sample that the browser has."""
        return self.run_method("show", frame, timeout=timeout)


class SceneView(
    ui.element, component="assets/airspace.js", esm={"quadctl-shapes": "assets/shapes"}
):
    """Vehicle in its cage. Events: `floor` with x and y, `step` with a key, `send`, `drop`."""

    def __init__(self, height: float, *, control: bool) -> None:
        """Show a ghost at `height` (m) above the floor under the pointer, only with `control`."""
        super().__init__()
        self._props["control"] = control
        self._props["keys"] = list(STEPS)
        self.raise_to(height)

    def raise_to(self, height: float) -> None:
        """Show the ghost at a height, m."""
        self._props["height"] = height
        self.update()


class Plot(ui.element, component="assets/plot.js"):
    """Plot of the last minute of one value; `field` is its index in a sample."""

    def __init__(self, field: int, title: str, read: str, *, least: float, since: int = -1) -> None:
        """Name the text beside the title `read`; show a range of at least `least`.

        Samples from before the last change of the field `since` are left out.
        """
        super().__init__()
        self._props |= {"field": field, "title": title, "read": read}
        self._props |= {"since": since, "least": least}


def floor_point(event: GenericEventArguments) -> tuple[float, float]:
    """Return the clicked point of the floor, m; raise TypeError or ValueError if there is none."""
    x, y = event.args["x"], event.args["y"]
    return float(x), float(y)
