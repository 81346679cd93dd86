"""Recordings of the missions in data/, flown again."""

import tempfile
from pathlib import Path

from quadctl.schemas.topics import POSE
from quadctl.services.runtime.bus.streams import RawMessage
from quadctl.services.runtime.recording.reader import Bag
from quadctl.services.runtime.recording.writer import BagWriter, Outfile
from tests.support.lab import Lab, private_lab
from tests.support.running import eventually

_DATA = Path(__file__).parent / "data"
SETTINGS = {"barometer": ("--set", "pressure.profile=bmp280"), "cage": ()}
"""Settings of each mission beside those of all, by its name."""
_BEFORE = 5
"""Number of poses kept from the boot before the flight's."""


def write(name: str) -> None:
    """Fly the mission of that name in lock-step, and keep its recording."""
    mission = _DATA / f"{name}.toml"
    with private_lab() as lab:
        lab.start("--set", "dynamics.speed=0", "--set", "dynamics.rate=20", *SETTINGS[name])
        trim(record(lab, mission), mission.with_suffix(".mcap"))


def record(lab: Lab, mission: Path) -> Path:
    """Record all messages while the mission is flown."""
    raw = lab.folder / "raw.mcap"
    run = lab.spawn(*lab.command("record", "-o", raw))
    eventually(lambda: "recording to" in run.log)
    done = lab.quadctl("fly", mission)
    assert done.code == 0, done
    run.send(2)
    assert run.wait() == 0, run.log
    return raw


def trim(raw: Path, target: Path) -> None:
    """Drop the messages only for viewers, and most of those before the flight."""
    boots = [m.value["boot"] for m in Bag(raw).messages() if m.key.endswith(f"/{POSE.name}")]
    first = boots.index(boots[-1])
    bag = Bag(raw)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        fresh = Path(folder) / "trimmed.mcap"
        writer, seen = BagWriter(Outfile.create(fresh), fresh.parent), 0
        for message in bag.messages():
            seen += message.key.endswith(f"/{POSE.name}")
            if message.derived or (seen <= first - _BEFORE and "/@call/" not in message.key):
                continue
            writer.add(
                RawMessage(
                    message.key, message.payload, message.encoding, message.at, message.published
                )
            )
        writer.note("quadctl", bag.notes["quadctl"])
        writer.finish()
        writer.close()
        fresh.replace(target)
