"""What a run keeps in its realm's folder: the lock, how it was launched, and its record."""

import os
from collections.abc import Callable
from typing import Self

import msgspec

from services.runtime import record
from services.runtime.ending import uninterrupted
from services.runtime.errors import AlreadyServed, QuadctlError
from services.runtime.lock import FileLock
from services.runtime.realm import Realm, write_atomically
from services.runtime.record import ProcessRecord, RunRecord
from services.runtime.run import disk
from services.runtime.run import launch as launching
from services.runtime.run.launch import Launch
from services.runtime.settings import snapshot


class Home:
    """Holds the realm within a `with` block, and leaves nothing of the run behind."""

    def __init__(self, launch: Launch) -> None:
        """The realm is taken where the block begins, which raises AlreadyServed when it is live."""
        self.realm, self._launch = Realm(launch.realm), launch
        self._lock: FileLock
        self._is_held = self._lost = False

    def write(self, rows: list[ProcessRecord]) -> None:
        """Write the record; raises OSError."""
        run = RunRecord(self.realm.name, os.getpid(), self._launch.vehicles, rows)
        record.write(self.realm, run)

    def mend(self, tell: Callable[[str], None]) -> bool:
        """Make the folder anew where somebody has removed it; whether it was made.

        Raises AlreadyServed where another run has taken the realm meanwhile.
        """
        if self._lock.stands():
            return False
        if not self._lost:
            self._lost = True
            tell(f"{self.realm.folder} was removed under the run")
        try:
            self._lock.release()
            self._lock = launching.hold(self.realm)
            self._furnish()
        except AlreadyServed:
            raise
        except (OSError, QuadctlError):
            # Told already; the next look tries again.
            return False
        self._lost = False
        tell(f"{self.realm.folder} was made anew, with the parameters of the launch")
        return True

    def leave(self) -> None:
        """Remove the folder, unless it is another run's by now."""
        if not self._is_held:
            return
        if self._lock.stands():
            self.realm.remove()
        self._lock.release()

    def _take(self) -> None:
        self._lock, self._is_held = launching.hold(self.realm), True
        try:
            self.realm.clear()
            self.address = launching.choose_address(self.realm, self._launch.params.hub.transport)
            disk.probe(self.realm.folder)
            self._furnish()
        except OSError as error:
            raise QuadctlError(
                f"{self.realm.folder} cannot be written: {error.strerror}",
                "make room on its disk, or set XDG_RUNTIME_DIR to a folder on another",
            ) from error

    def _furnish(self) -> None:
        snapshot.save_all(self.realm, self._launch.fleet)
        write_atomically(self.realm.address, msgspec.json.encode(self.address))

    def __enter__(self) -> Self:
        try:
            with uninterrupted():
                self._take()
        except BaseException:
            self.leave()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.leave()
