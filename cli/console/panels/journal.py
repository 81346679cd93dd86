"""The log of verdicts, the newest first."""

from html import escape

from nicegui import ui

from cli.console.board import Glance
from cli.console.panels.card import card
from cli.console.verdicts import Verdict

_NONE = '<li class="none">Nothing asked yet.</li>'


class Journal:
    """Written anew when a line has come."""

    def __init__(self) -> None:
        self._noted = 0
        with card("Verdicts", "journal"):
            self._list = ui.html(_NONE, sanitize=False, tag="ol").props("role=log")

    def refresh(self, now: Glance) -> None:
        """Show what was written since."""
        if now.noted != self._noted:
            self._noted = now.noted
            self._list.content = "".join(map(line, now.verdicts))


def line(verdict: Verdict) -> str:
    """A line as HTML; reasons come from a user's own nodes too."""
    return (
        f'<li class="{escape(verdict.kind)}"><time>{verdict.stamp:.1f} s</time>'
        f"<b>{escape(verdict.kind)}</b><span>{escape(verdict.text)}</span></li>"
    )
