"""Report of a campaign: one page that needs no network, and shows the worst flights."""

import json
import os
import re
import sqlite3
from collections import Counter
from contextlib import closing
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from quadctl.services.campaign.report import write
from quadctl.services.campaign.track import FlightTrack
from quadctl.services.runtime.errors import Invalid

pytestmark = pytest.mark.thorough

OUTSIDE = "MOVING to a <goal> outside"
TABLE = "CREATE TABLE flights(seed INTEGER PRIMARY KEY, worst_excursion, at, wind, faults, guards, violations)"
CONDITIONS = {"seconds": 10.0, "faults": True, "wind": 0.0, "given": {"safety.margin": 0.5}}


def campaign(flights: int, violations: dict[int, list[str]]) -> tuple[sqlite3.Connection, dict]:
    """Return a database and a document; a seed's excursion is that many mm."""
    connection = sqlite3.connect(":memory:")
    connection.execute(TABLE)
    connection.execute("CREATE TABLE campaign(conditions)")
    connection.execute("INSERT INTO campaign VALUES (?)", (json.dumps(CONDITIONS),))
    fired = json.dumps({"HOVERING Booted always": 1, "MOVING Seen arrived": 1234})
    for seed in range(flights):
        faults = json.dumps({"Deaf": 2} if seed else {})
        found = json.dumps(violations.get(seed, []))
        values = (seed, seed / 1000, 1.5, "[0.0, 0.0]", faults, fired, found)
        connection.execute("INSERT INTO flights VALUES (?, ?, ?, ?, ?, ?, ?)", values)
    figures = {
        "flights": flights, "seed": 0, "worst_excursion": (flights - 1) / 1000,
        "worst": {"seed": flights - 1, "at": 1.5},
        "transitions": {"HOVERING -> MOVING": 1}, "refusals": {"busy": 12345}, "stops": {},
        "arrivals": {"count": 3, "median": 1.0, "p90": 2.0, "p99": 3.0, "most": 4.25},
        "violations": [{"seed": seed, "what": what} for seed, what in violations.items()],
        "hash": "5ha",
    }  # fmt: skip
    return connection, figures


def track(seed: int) -> FlightTrack:
    times = np.linspace(0.0, 10.0, 21)
    cages = np.full((21, 3), 2.0)
    cages[15:] = np.nan
    return FlightTrack(times, np.stack([times / 5, -times / 5, times / 4], axis=1), cages, 0.5)


def written(file: Path, flights: int = 12, violations: dict[int, list[str]] | None = None) -> str:
    connection, figures = campaign(flights, violations or {})
    commands = "quadctl campaign <all>", "quadctl campaign --replay {}".format
    with closing(connection):
        write(file, connection, figures, *commands, track)
    return file.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    return written(
        tmp_path_factory.mktemp("report") / "page.html", 12, {3: [OUTSIDE], 4: [OUTSIDE]}
    )


class Reader(HTMLParser):
    """Elements, identifiers and texts of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids = Counter[str]()
        self.attributes: list[tuple[str, str | None]] = []
        self.texts: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += attrs
        self.ids.update(str(value) for name, value in attrs if name == "id")
        if tag != "meta":
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, Any]]) -> None:
        self.handle_starttag("meta", attrs)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.texts.append(data.strip().replace("\u202f", " "))


def test_the_page_is_well_formed_and_loads_nothing(page: str):
    reader = Reader(page)
    assert reader.open == []
    assert max(reader.ids.values()) == 1
    links = {value for name, value in reader.attributes if name in {"src", "href", "xlink:href"}}
    assert all(str(link).startswith("#") for link in links)
    assert {str(link)[1:] for link in links} <= reader.ids.keys()
    assert "@import" not in page
    assert all(address.startswith("#") for address in re.findall(r"url\(([^)]*)\)", page))


def test_the_page_names_the_headline_figures(page: str):
    texts = Reader(page).texts
    bound = "≤ 43.9 %"  # scipy.stats.beta.ppf(0.95, 3, 10), rounded up
    for text in ("12", "11 mm", "2 flights broke a promise", bound, "5ha", "12 345", "4.25 s"):
        assert text in texts, text
    assert "quadctl campaign <all>" in texts
    assert "safety.margin=0.5" in texts


def test_violations_come_first_and_then_the_worst(page: str):
    seeds = [int(seed) for seed in re.findall(r"<h3>seed (\d+)</h3>", page)]
    assert seeds == [4, 3, 11, 10, 9, 8, 7, 6, 5, 2]
    assert Reader(page).texts.count(OUTSIDE) == 1 + 2
    assert page.count("<code>quadctl campaign --replay 3</code>") == 1 + 1


def test_rules_that_never_fired_are_marked_and_counted(page: str):
    assert "Never fired: <b>33 of 52</b> rules, and 17 more" in page
    assert page.count('<tr class="never">') == 33
    texts = Reader(page).texts
    row = texts.index("arrived")
    assert texts[row + 1 : row + 6] == ["→ HOVERING", "arrive", "14 808", "1 234", "13 574"]


def test_text_in_pictures_is_text_in_the_colours_of_the_page(page: str):
    texts = Reader(page).texts
    assert texts.count("from above") == 10
    assert "margin: beyond it is a violation" in texts
    assert "#01020" not in page
    assert "DejaVu" not in page


def test_a_flight_without_excursion_has_a_picture(tmp_path: Path):
    page = written(tmp_path / "page.html", 1)
    assert "no promise was broken" in page
    assert "never beyond the cage" in page
    assert "<h2>Violations</h2>" not in page


def test_a_report_replaces_an_older_one_and_leaves_no_other_file(tmp_path: Path):
    file = tmp_path / "page.html"
    file.write_text("old")
    assert written(file, 1).startswith("<!DOCTYPE html>")
    assert [each.name for each in tmp_path.iterdir()] == ["page.html"]


def test_a_folder_that_does_not_exist_is_an_error(tmp_path: Path):
    with pytest.raises(Invalid, match="cannot be written: No such file") as error:
        written(tmp_path / "none" / "page.html", 1)
    assert error.value.hint
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_the_old_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    file = tmp_path / "page.html"
    file.write_text("old")

    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(Invalid, match="No space left"):
        written(file, 1)
    assert [(each.name, each.read_text()) for each in tmp_path.iterdir()] == [("page.html", "old")]
