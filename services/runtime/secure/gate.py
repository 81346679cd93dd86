"""What the gate needs to know before it opens: who it is, and what it lets through."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from services.runtime.errors import UsageError
from services.runtime.secure import names
from services.runtime.secure.access import access_control
from services.runtime.secure.identity import Identity, needed
from services.runtime.secure.names import LIST


def identity_for(endpoints: Sequence[str]) -> Identity:
    """The hub's identity; raises UsageError where it is not given, or is no hub's."""
    who = needed(endpoints[0])
    if who.name.role != "hub":
        raise UsageError(
            f"{endpoints[0]} needs the identity of a hub: {who.folder} is that of the"
            f" {who.name.role} {who.name.name}",
            "`quadctl keys issue hub field` makes one",
        )
    return who


def rules(who: Identity, link: str) -> dict[str, Any]:
    """Zenoh's access control as the list of names has it now; `link` is our own hub's protocol."""
    return access_control(names.load(Path(who.folder)), time.time(), link)


class Watch:
    """Tells when the list of names is another one than it was."""

    def __init__(self, folder: str) -> None:
        self._file = Path(folder) / LIST
        self._seen = self._look()

    def changed(self) -> bool:
        """Whether it has changed since the watch began."""
        return self._look() != self._seen

    def _look(self) -> bytes:
        try:
            return self._file.read_bytes()
        except FileNotFoundError:
            return b""
