"""The parameters of a run as they are now: a folder a vehicle, and a file a node in it.

Each file is written by that node alone.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from schemas.params import Params
from services.runtime.errors import QuadctlError
from services.runtime.realm import Realm, write_atomically
from services.runtime.settings import kept
from services.runtime.settings.params import check


def save_all(realm: Realm, fleet: Mapping[str, Params]) -> None:
    """Write every table of each vehicle; done once, before anything starts. Raises OSError."""
    for vehicle, params in fleet.items():
        folder = realm.params / vehicle
        folder.mkdir(parents=True, exist_ok=True)
        for name, table in msgspec.to_builtins(params).items():
            _write(folder, name, table)


def save(realm: Realm, vehicle: str, name: str, table: Any) -> None:
    """Write one table of a live run; raises QuadctlError where the disk does not take it."""
    folder = realm.params / vehicle
    if not folder.is_dir():
        return
    try:
        _write(folder, name, table)
    except OSError as error:
        raise QuadctlError(
            f"the parameters of {name} cannot be kept in {folder}: {error.strerror}",
            "make room on its disk",
        ) from error


def _write(folder: Path, name: str, table: Any) -> None:
    write_atomically(folder / f"{name}.json", msgspec.json.encode(table))


def read(realm: Realm, vehicle: str) -> Params | None:
    """A vehicle's parameters, None where the run has no such vehicle, or there is no run."""
    tables = kept.tables(realm, vehicle)
    return check(tables, str(realm.params / vehicle)) if tables else None
