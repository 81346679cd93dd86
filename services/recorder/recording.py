"""Recording in progress: messages from the bus, and the scene that viewers draw from them."""

import math
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from quadctl.services.runtime.bus.streams import RawMessage
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.files import making
from quadctl.services.runtime.recording.scene import Drawing
from quadctl.services.runtime.recording.writer import BagWriter, Outfile


class Recording:
    """File of one recording; `flush` and `end` raise QuadctlError if it cannot be written."""

    def __init__(self, path: Path, notes: dict[str, str], most: float = math.inf) -> None:
        """Create the file with notes about the run; raises Invalid if it cannot be created.

        A file of more than `most` bytes takes no more messages.
        """
        self.path, self.lost, self.connected = path, 0, True
        self._most = most
        self._began = time.monotonic()
        self._drawings: dict[str, Drawing] = {}
        with making(path):
            self._out = Outfile.create(path)
        try:
            self._bag = BagWriter(self._out, path.parent)
            self._bag.note("quadctl", notes)
            self._bag.flush()
        except OSError as error:
            self._out.close()
            path.unlink(missing_ok=True)
            raise QuadctlError(f"{path}: {error.strerror}", "make room on its disk") from error

    @property
    def left_out(self) -> int:
        """Return how many messages are not recorded: the file has no room for more keys."""
        return self._bag.left_out

    def take(self, messages: Iterable[RawMessage]) -> None:
        """Buffer messages until the next `flush`."""
        for message in messages if self._bag.size < self._most else ():
            typed = self._bag.add(message).message
            vehicle = message.key.partition("/")[0]
            drawing = self._drawings.get(vehicle)
            if drawing is None:
                drawing = self._drawings[vehicle] = Drawing(vehicle)
            if derived := drawing.derive(message.key, typed, message.at):
                self._bag.derive(*derived, message.at)

    def flush(self) -> None:
        """Write the buffer to the file; a crash of this process no longer loses it."""
        try:
            self._bag.flush()
            self._check()
        except OSError as error:
            self._bag.close()
            raise self._stopped(error) from error
        except QuadctlError:
            self._bag.close()
            raise

    def end(self) -> None:
        """Write the index and close the file."""
        try:
            self._bag.finish()
            self._check()
            if not self._out.is_at(self.path):
                raise QuadctlError(
                    f"{self.path} was moved while it was recorded; where it is now, it is complete",
                    "end a recording before you move its file",
                )
        except OSError as error:
            raise self._stopped(error) from error
        finally:
            self._bag.close()

    def _check(self) -> None:
        if self._out.is_removed():
            raise QuadctlError(
                f"the recording has stopped: another program has removed or replaced {self.path}",
                "record again, to a file that nothing else touches",
            )

    def facts(self, state: str) -> dict[str, Any]:
        """Return the progress to display."""
        bag = self._bag
        return {
            "state": state,
            "file": str(self.path),
            "seconds": time.monotonic() - self._began,
            "messages": bag.messages,
            "keys": len(bag.keys),
            "bytes": bag.size,
            "lost": self.lost + self.left_out,
            "connected": self.connected,
        }

    def _stopped(self, error: OSError) -> QuadctlError:
        return QuadctlError(
            f"the recording has stopped: {self.path} cannot be written: {error.strerror};"
            f" {self._bag.size} bytes of it are saved",
            f"make room, then `quadctl bag repair {self.path}` completes it",
        )
