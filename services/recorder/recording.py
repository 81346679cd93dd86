"""Growing recording: messages from the bus, and the scene that viewers draw of them."""

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from quadctl.schemas.messages import Pose, SafetyState
from quadctl.services.recorder.foxglove import SCENE, TRANSFORM, Scene
from quadctl.services.runtime.bus.raw import RawMessage
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.files import making
from quadctl.services.runtime.recording.writer import BagWriter, Outfile

FRAMES_KEY, SCENE_KEY = "/tf", "/scene"
"""Where viewers look; no key of Zenoh begins so."""


class Recording:
    """One file; `flush` and `end` raise QuadctlError where the disk does not take it."""

    def __init__(self, path: Path, notes: dict[str, str]) -> None:
        """Make the file, with facts about the run; raises Invalid where that cannot be."""
        self.path, self.lost, self.connected = path, 0, True
        self._began = time.monotonic()
        self._scenes: dict[str, Scene] = {}
        with making(path):
            self._out = Outfile.create(path)
        try:
            self._bag = BagWriter(self._out)
            self._bag.note("quadctl", notes)
            self._bag.flush()
        except OSError as error:
            self._out.close()
            path.unlink(missing_ok=True)
            raise QuadctlError(f"{path}: {error.strerror}", "make room on its disk") from error

    def take(self, messages: Iterable[RawMessage]) -> None:
        """Keep messages, until the next `flush`."""
        for message in messages:
            self._keep(message)

    def flush(self) -> None:
        """Hand what is kept to the system, after which it is not lost with this process."""
        try:
            self._bag.flush()
        except OSError as error:
            self._bag.close()
            raise self._stopped(error) from error

    def end(self) -> None:
        """Make the file whole."""
        try:
            self._bag.finish()
        except OSError as error:
            raise self._stopped(error) from error
        finally:
            self._bag.close()

    def facts(self, state: str) -> dict[str, Any]:
        """How far it is, for whoever shows it."""
        bag = self._bag
        return {
            "state": state,
            "file": str(self.path),
            "seconds": time.monotonic() - self._began,
            "messages": bag.messages,
            "keys": len(bag.keys),
            "bytes": bag.size,
            "lost": self.lost,
            "connected": self.connected,
        }

    def _keep(self, message: RawMessage) -> None:
        said = self._bag.add(message).message
        if not isinstance(said, Pose | SafetyState):
            return
        vehicle = message.key.partition("/")[0]
        scene = self._scenes.get(vehicle)
        if scene is None:
            scene = self._scenes[vehicle] = Scene(vehicle)
        if isinstance(said, Pose):
            self._bag.derive(FRAMES_KEY, TRANSFORM, scene.frame(said, message.at), message.at)
        elif update := scene.update(said, message.at):
            self._bag.derive(SCENE_KEY, SCENE, update, message.at)

    def _stopped(self, error: OSError) -> QuadctlError:
        return QuadctlError(
            f"the recording has stopped: {self.path} cannot be written: {error.strerror};"
            f" {self._bag.size} bytes of it are there",
            f"make room, then `quadctl bag repair {self.path}` makes it whole",
        )
