"""The files of a run's parameters, read as they are: without what it takes to check them."""

from typing import Any

import msgspec

from services.runtime.realm import Realm

UNSERVED = ("supervise", "processes")
"""Tables of the supervisor, which is no node: nobody on the bus has them, and nothing sets them."""


def tables(realm: Realm, vehicle: str) -> dict[str, Any]:
    """A vehicle's tables by name, none where the run has no such vehicle, or there is no run."""
    files = sorted((realm.params / vehicle).glob("[!.]*.json"))
    return {file.stem: msgspec.json.decode(file.read_bytes()) for file in files}
