"""SQLite file of a campaign's flights, from which it continues. Any SQLite tool reads it."""

import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec

from quadctl.schemas.typed import converted
from quadctl.services.campaign.mission import Conditions
from quadctl.services.campaign.score import Flown
from quadctl.services.runtime.errors import Invalid, QuadctlError

COLUMNS = {
    "seed": "INTEGER PRIMARY KEY", "cage": "JSON", "worst_excursion": "REAL", "at": "REAL",
    "transitions": "JSON", "refusals": "JSON", "stops": "JSON", "guards": "JSON", "wind": "JSON",
    "faults": "JSON", "arrivals": "JSON", "violations": "JSON", "hash": "TEXT", "separation": "JSON",
}  # fmt: skip
"""Columns of the table `flights`: the fields of Flown, in their order."""
_TABLES = (
    "CREATE TABLE IF NOT EXISTS campaign (conditions JSON, probe TEXT)",
    f"CREATE TABLE IF NOT EXISTS flights ({', '.join(map(' '.join, COLUMNS.items()))})",
)


_INSERT = "INSERT OR IGNORE INTO flights VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
_RANGE = "FROM flights WHERE seed BETWEEN ? AND ? ORDER BY seed"


class Database:
    """File of flights under one set of conditions, by one version of the automaton and dynamics."""

    def __init__(self, file: str, conditions: Conditions, probe: str) -> None:
        """Open or create the file; `probe` is the hash of a flight that tells versions apart.

        Raises Invalid if the file holds anything else.
        """
        self._file = file
        with _explained(file, Invalid):
            # The caller serializes its threads.
            self.connection = sqlite3.connect(file, check_same_thread=False)
        try:
            self._claim(conditions, probe)
        except Invalid:
            self.close()
            raise

    def _claim(self, conditions: Conditions, probe: str) -> None:
        """Make the tables if there are none; raise Invalid if the file holds anything else."""
        own = (msgspec.json.encode(conditions, order="deterministic").decode(), probe)
        with _explained(self._file, Invalid), self.connection as opened:
            for table in _TABLES:
                opened.execute(table)
            columns = [about[0] for about in opened.execute("SELECT * FROM flights").description]
            found = opened.execute("SELECT conditions, probe FROM campaign").fetchone()
            if found is None:
                opened.execute("INSERT INTO campaign VALUES (?, ?)", own)
        held = found or own
        for what, theirs, ours, same in (
            ("under other conditions", held[0], own[0], _is_of(held[0], conditions, own[0])),
            ("by another version", held[1], own[1], held[1] == own[1]),
            ("by another version", columns, [*COLUMNS], columns == [*COLUMNS]),
        ):
            if not same:
                raise Invalid(
                    f"{self._file} has flights {what}: {theirs}, and not {ours}",
                    "choose another --db FILE",
                )

    def close(self) -> None:
        """Close the file; no other method works after it."""
        self.connection.close()

    def add(self, flights: Iterable[Flown]) -> None:
        """Store flights; those that are there already stay. Raises QuadctlError if it fails."""
        rows = [
            [_stored(getattr(flight, name), kind) for name, kind in COLUMNS.items()]
            for flight in flights
        ]
        with _explained(self._file, QuadctlError), self.connection as opened:
            opened.executemany(_INSERT, rows)

    def flights(self, seeds: range) -> Iterator[Flown]:
        """Yield the stored flights with these seeds, in their order."""
        with _explained(self._file, QuadctlError):
            for row in self.connection.execute(f"SELECT * {_RANGE}", (seeds.start, seeds.stop - 1)):
                fields = zip(COLUMNS.items(), row, strict=True)
                yield converted(
                    {
                        name: msgspec.json.decode(value) if kind == "JSON" else value
                        for (name, kind), value in fields
                    },
                    Flown,
                )

    def missing(self, seeds: range, longest: int) -> Iterator[range]:
        """Yield the seeds without a flight, in ranges of at most `longest`."""
        start = seeds.start
        with _explained(self._file, QuadctlError):
            stored = self.connection.execute(
                f"SELECT seed {_RANGE}", (seeds.start, seeds.stop - 1)
            ).fetchall()
        for end in (*(seed for (seed,) in stored), seeds.stop):
            for first in range(start, end, longest):
                yield range(first, min(first + longest, end))
            start = end + 1


def _is_of(held: str, conditions: Conditions, own: str) -> bool:
    """Compare a file's conditions with ours, also written as `own`; an older file lacks some."""
    if held == own:
        return True
    try:
        table = msgspec.json.decode(held)
        known = converted(table, Conditions)
    except msgspec.MsgspecError:
        return False
    # A newer version may have flown under more than is known here.
    return known == conditions and set(table) <= set(Conditions.__struct_fields__)


@contextmanager
def _explained(file: str, kind: type[QuadctlError]) -> Iterator[None]:
    try:
        yield
    except sqlite3.Error as error:
        full = getattr(error, "sqlite_errorcode", 0) == sqlite3.SQLITE_FULL
        hint = (
            "make room on its disk" if full else "--db takes an SQLite file, new or of a campaign"
        )
        raise kind(f"{file} cannot be used: {error}", hint) from error


def _stored(value: Any, kind: str) -> Any:
    return msgspec.json.encode(value).decode() if kind == "JSON" else value
