"""One run of the system from first to last: the realm, its hub's address, its supervisor."""

from collections.abc import Callable
from typing import TextIO

import msgspec

from services.runtime import (
    entry,  # noqa: F401 - what every node begins with, loaded once for all that are forked
    snapshot,
)
from services.runtime import launch as launching
from services.runtime.launch import Launch
from services.runtime.logs import Logs
from services.runtime.realm import Realm, write_atomically
from services.runtime.supervise import Supervisor


def run(launch: Launch, stream: TextIO, on_settled: Callable[[Supervisor, str], None]) -> int:
    """Supervise until a signal; returns its number. Leaves nothing of the run behind.

    Raises AlreadyServed when the realm is live.
    """
    realm = Realm(launch.realm)
    lock = launching.hold(realm)
    try:
        snapshot.save_all(realm, launch.params)
        address = launching.choose_address(realm, launch.params.hub.transport)
        write_atomically(realm.address, msgspec.json.encode(address))
        supervisor = Supervisor(launch, realm, address, Logs(realm.logs, stream))
        return supervisor.run(lambda failed: on_settled(supervisor, failed))
    finally:
        realm.remove()
        lock.release()
