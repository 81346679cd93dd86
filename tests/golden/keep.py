"""Command that keeps the contract and a file of each kind of a release: `python -m tests.golden.keep 1.1`.

Run it once, as a part of the release. It makes a folder `kept/VERSION`, and never writes it again.
"""

import argparse
import shutil
from datetime import timedelta
from pathlib import Path

from quadctl.services.runtime.security import authority
from quadctl.services.runtime.security.registry import Registry
from tests.golden import data, digests, product, releases, shapes
from tests.recording import recordings
from tests.support.lab import Lab, private_lab

ROOT = Path(__file__).parents[2]
FILES = {
    "mission.toml": ROOT / "examples" / "mission.toml",
    "fleet.toml": ROOT / "examples" / "fleet.toml",
    "rubric.toml": ROOT / "cli" / "lab" / "rubric.toml",
}
CAMPAIGN = ("--flights", 3, "--seconds", 4, "--seed", 3, "--faults", "--wind", 2)
_YEARS = 90
"""Life of the kept certificates: tests use them for as long as the project lasts, on any clock."""


def main() -> None:
    """Write the folder of a version."""
    parser = argparse.ArgumentParser(description="Keep the contract of a release.")
    parser.add_argument("version")
    folder = releases.KEPT / parser.parse_args().version
    folder.mkdir(parents=True)
    for name in releases.DOCUMENTS:
        content = releases.promised(name, data.read(name))
        (folder / f"{name}.json").write_text(releases.compact(content), encoding="utf-8")
    (folder / "quad.toml").write_text(product.default_file(), encoding="utf-8")
    for name, source in FILES.items():
        shutil.copy(source, folder / name)
    _keys(folder / "keys")
    with private_lab() as lab:
        _recording(lab, folder / "flight.mcap")
    with private_lab() as lab:
        done = lab.quadctl("campaign", *CAMPAIGN, "--db", folder / "campaign.sqlite")
        assert done.code == 0, done
    digests.write()


def _keys(folder: Path) -> None:
    authority._YEARS = _YEARS + 1  # `keys init` gives a fleet ten years
    authority._SLACK = timedelta(days=3650)  # and five minutes before now
    fleet = Registry(folder)
    fleet.init()
    fleet.issue("hub", {"hub": ["*"]}, 365 * _YEARS, ["localhost", "127.0.0.1"])
    fleet.issue("operator", {"anna": ["uav"]}, 365 * _YEARS, [])
    (folder / ".lock").unlink(missing_ok=True)


def _recording(lab: Lab, target: Path) -> None:
    mission = lab.file(shapes.MISSION, "mission.toml")
    lab.start("--set", "dynamics.lockstep=true", "--set", "dynamics.rate=20")
    recordings.trim(recordings.record(lab, mission), target)


if __name__ == "__main__":
    main()
