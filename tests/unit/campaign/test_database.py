"""Database of a campaign: flights in and out, gaps, and files of something else."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import given, settings, strategies as st

from quadctl.services.campaign.database import Database
from quadctl.services.campaign.mission import Conditions
from quadctl.services.runtime.errors import Invalid, QuadctlError
from tests.support.campaign_flights import batch

CONDITIONS = Conditions(2.0, faults=True, given={"safety.takeoff": 2.0})


def test_flights_come_back_as_they_were_and_in_order(tmp_path: Path):
    file = str(tmp_path / "flights.sqlite")
    flown = batch(range(4), 2.0, faults=True).fly()
    with closing(Database(file, CONDITIONS, "probe")) as database:
        database.add(reversed(flown))
    with closing(Database(file, CONDITIONS, "probe")) as again:
        again.add(flown)
        assert list(again.flights(range(10))) == flown
        assert list(again.flights(range(1, 3))) == flown[1:3]


@pytest.mark.thorough
@settings(max_examples=50)
@given(st.sets(st.integers(0, 12)), st.integers(1, 5))
def test_the_missing_seeds_are_those_without_a_flight(stored: set[int], longest: int):
    rows = [(seed, *["{}"] * 13) for seed in stored]
    with closing(Database(":memory:", CONDITIONS, "probe")) as database:
        database.connection.executemany(
            "INSERT INTO flights VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", rows
        )
        found = list(database.missing(range(2, 11), longest))
    assert all(1 <= len(part) <= longest for part in found)
    assert [seed for part in found for seed in part] == sorted(set(range(2, 11)) - stored)


@pytest.mark.parametrize(
    ("conditions", "probe", "what"),
    [(Conditions(3.0), "probe", "other conditions"), (CONDITIONS, "new", "another version")],
)
def test_flights_of_another_campaign_are_refused(
    tmp_path: Path, conditions: Conditions, probe: str, what: str
):
    file = str(tmp_path / "flights.sqlite")
    Database(file, CONDITIONS, "probe").close()
    with pytest.raises(Invalid, match=what):
        Database(file, conditions, probe)


def altered(tmp_path: Path, *statements: str) -> str:
    """Return a database that another version might have written."""
    file = str(tmp_path / "flights.sqlite")
    Database(file, CONDITIONS, "probe").close()
    with closing(sqlite3.connect(file)) as opened, opened:
        for statement in statements:
            opened.execute(statement)
    return file


def test_flights_from_before_a_condition_existed_are_continued(tmp_path: Path):
    older = "UPDATE campaign SET conditions = json_remove(conditions, '$.vehicles', '$.wind')"
    Database(altered(tmp_path, older), CONDITIONS, "probe").close()


@pytest.mark.parametrize(
    ("statement", "what"),
    [
        ("UPDATE campaign SET conditions = json_set(conditions, '$.rain', 1)", "other conditions"),
        ("UPDATE campaign SET conditions = 'rain'", "other conditions"),
        ("ALTER TABLE flights ADD COLUMN rain JSON", "another version"),
        ("ALTER TABLE flights DROP COLUMN separation", "another version"),
    ],
)
def test_flights_of_a_version_with_other_facts_are_refused_unchanged(
    tmp_path: Path, statement: str, what: str
):
    file = altered(tmp_path, statement)
    before = Path(file).read_bytes()
    with pytest.raises(Invalid, match=what):
        Database(file, CONDITIONS, "probe")
    assert Path(file).read_bytes() == before


def test_a_file_that_is_no_database_is_refused_unchanged(tmp_path: Path):
    file = tmp_path / "notes.txt"
    file.write_text("notes" * 100)
    for other in (file, tmp_path / "none" / "x"):
        with pytest.raises(Invalid, match=f"{other.name} cannot be used: ") as caught:
            Database(str(other), CONDITIONS, "probe")
        assert "--db" in caught.value.hint
    assert file.read_text() == "notes" * 100


def test_a_file_that_cannot_be_written_is_an_error():
    with closing(Database(":memory:", CONDITIONS, "probe")) as database:
        database.connection.execute("PRAGMA query_only = on")
        with pytest.raises(QuadctlError, match="cannot be used: "):
            database.add(batch([0], 1.0).fly())
