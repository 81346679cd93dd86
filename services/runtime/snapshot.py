"""The parameters of a run as they are now, one file a node, each written by that node alone."""

from pathlib import Path
from typing import Any

import msgspec

from schemas.params import Params
from services.runtime.params import check
from services.runtime.realm import Realm, write_atomically


def save_all(realm: Realm, params: Params) -> None:
    """Write every table; done once, at launch, before anything starts."""
    realm.params.mkdir(exist_ok=True)
    for name, table in msgspec.to_builtins(params).items():
        save(realm.params, name, table)


def save(folder: Path, name: str, table: Any) -> None:
    """Write one table."""
    write_atomically(folder / f"{name}.json", msgspec.json.encode(table))


def read(realm: Realm) -> Params | None:
    """The run's parameters, None where there is no run."""
    files = sorted(realm.params.glob("[!.]*.json"))
    tables = {file.stem: msgspec.json.decode(file.read_bytes()) for file in files}
    return check(tables, str(realm.params)) if tables else None
