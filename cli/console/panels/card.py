"""A card of the page, with its heading."""

from collections.abc import Iterator
from contextlib import contextmanager

from nicegui import ui


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
