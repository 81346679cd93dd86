"""One row of the process table at work."""

from services.runtime import record
from services.runtime.child import Child
from services.runtime.processes import Life, Process


class Row:
    """A process, its life, and the child that is running it now, if any."""

    def __init__(self, process: Process) -> None:
        self.process, self.life = process, Life()
        self.child: Child | None = None
        self.due: float | None = 0.0

    def record(self) -> record.ProcessRecord:
        """The row of the run record."""
        pid = self.child.pid if self.child else 0
        return record.ProcessRecord(self.process.name, pid, self.life.state, self.life.restarts)
