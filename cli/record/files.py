"""What recordings are called."""

import time
from pathlib import Path

from services.runtime.files import taken

ENDING = ".mcap"


def default_file() -> Path:
    """As rosbag names its own: by the time of day, in the working directory."""
    return Path(time.strftime(f"quadctl_%Y-%m-%d_%H-%M-%S{ENDING}"))


def free(path: Path) -> None:
    """Raise Invalid where the file is there already: no recording is written over."""
    if path.exists():
        raise taken(path)
