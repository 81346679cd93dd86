"""Pictures of the console and of a campaign's report, as Chromium shows them."""

from pathlib import Path

from tests.support.browser import PHONE, Tab, browser
from tests.support.lab import private_lab
from tests.support.served_console import served

_SIZE = (1440, 1060)
_ZONES = """
[[safety.zones]]
name = "tower"
polygon = [[-3.9, -0.6], [-2.7, -0.6], [-2.7, 0.6], [-3.9, 0.6]]
[[safety.zones]]
name = "pond"
circle = { x = 0.5, y = 1.2, radius = 0.8 }
ceiling = 1.5
"""
_REPORT = ("campaign", "--flights", 10_000, "--seed", 1, "--faults", "--report", "report.html")


def _fly(page: Tab) -> None:
    """Fly a round with a refusal and a calibration for the pictures."""
    page.until(
        "document.body?.dataset.link === 'live' && document.body.dataset.state === 'HOVERING'", 40
    )
    page.press(".act.calibrate")
    page.reads(".journal", "baseline")
    for x, y in ((3, -2), (3, 3), (-3, 3)):
        page.floor(x, y)
        page.reads(".journal", f"at ({x}, {y}, 1)", within=30)
    for key in ("PageUp", "ArrowDown", "Enter"):
        page.key(key)
    page.reads(".journal", "at (-3, 2, 2)", within=30)
    page.js("document.activeElement.blur()")
    page.floor(7, 1)
    page.reads(".journal", "refused")
    page.until("!document.querySelector('.q-notification')", 30)


def draw_console(desk: Path, phone: Path) -> None:
    """Fly among zones, and draw the console on a desk and on a phone."""
    with private_lab() as lab:
        lab.start(lab.file(_ZONES), "--set", "safety.virtual_cage.z=3")
        with served(lab) as console, browser() as chromium:
            page = chromium.tab(console.control, _SIZE)
            _fly(page)
            small = chromium.tab(console.control, PHONE)
            small.until("document.body?.dataset.link === 'live'", 40)
            page.floor(-3, -2)
            page.reads(".safety .leg", "leg 2 of 3")
            page.picture(desk)
            small.reads(".journal", "at (-3, -2, 1)", within=30)
            small.picture(phone)


def draw_report(file: Path) -> None:
    """Run a campaign, and draw its report."""
    with private_lab() as lab, browser() as chromium:
        lab.quadctl(*_REPORT, timeout=600.0)
        report = chromium.tab(f"file://{lab.folder / 'report.html'}", (1200, 1000))
        report.until("!!document.querySelector('.tile')")
        report.picture(file)
