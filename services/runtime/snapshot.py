"""The parameters of a run as they are now, one file a node, each written by that node alone."""

from pathlib import Path
from typing import Any

import msgspec

from schemas.params import Params
from services.runtime.errors import QuadctlError
from services.runtime.params import check
from services.runtime.realm import Realm, write_atomically


def save_all(realm: Realm, params: Params) -> None:
    """Write every table; done once, at launch, before anything starts. Raises OSError."""
    realm.params.mkdir(exist_ok=True)
    for name, table in msgspec.to_builtins(params).items():
        _write(realm.params, name, table)


def save(folder: Path, name: str, table: Any) -> None:
    """Write one table; raises QuadctlError where the disk does not take it."""
    try:
        _write(folder, name, table)
    except OSError as error:
        raise QuadctlError(
            f"the parameters of {name} cannot be kept in {folder}: {error.strerror}",
            "make room on its disk",
        ) from error


def _write(folder: Path, name: str, table: Any) -> None:
    write_atomically(folder / f"{name}.json", msgspec.json.encode(table))


def read(realm: Realm) -> Params | None:
    """The run's parameters, None where there is no run."""
    files = sorted(realm.params.glob("[!.]*.json"))
    tables = {file.stem: msgspec.json.decode(file.read_bytes()) for file in files}
    return check(tables, str(realm.params)) if tables else None
