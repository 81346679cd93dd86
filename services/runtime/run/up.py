"""One run of the system from first to last: the realm, its hub's address, its supervisor."""

from collections.abc import Callable
from typing import TextIO

from services.runtime import (
    entry,  # noqa: F401 - what every node begins with, loaded once for all that are forked
)
from services.runtime.run.home import Home
from services.runtime.run.launch import Launch
from services.runtime.run.logs import Emit, Logs, Printer
from services.runtime.run.supervise import Supervisor


def run(
    launch: Launch,
    stream: TextIO | Emit,
    on_settled: Callable[[Supervisor, str], None],
    on_look: Callable[[Supervisor], None] | None = None,
) -> int:
    """Supervise until a signal; returns its number. Leaves nothing of the run behind.

    Lines go to a text stream, or to a function. `on_look` is called ten times a second.
    Raises AlreadyServed when the realm is live.
    """
    with Home(launch) as home:
        logs = Logs(home.realm.logs, stream if callable(stream) else Printer(stream))
        supervisor = Supervisor(launch, home, logs)
        return supervisor.run(
            lambda failed: on_settled(supervisor, failed),
            lambda: on_look(supervisor) if on_look else None,
        )
