"""Height and pressure over the last minute."""

from nicegui import ui

from cli.console.board import Sample
from cli.console.panels.card import card, read
from cli.console.parts import Plot

_FIELDS = Sample._fields[1:]


def readings() -> None:
    """Two plots, and the baseline."""
    with card("Readings", "readings"):
        Plot(_FIELDS.index("z"), "height", "height", least=1.0)
        baseline = _FIELDS.index("baseline")
        Plot(_FIELDS.index("pressure"), "pressure", "pressure", least=2e-4, since=baseline)
        with ui.element("dl"):
            ui.html("baseline", sanitize=False, tag="dt")
            read("baseline", tag="dd")
