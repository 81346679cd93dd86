"""Linux's IIO devices: where they are, and the small files in which they give their values."""

import os
from pathlib import Path

from services.runtime.errors import QuadctlError

DEVICES = Path("/sys/bus/iio/devices")
_MOST = 200
"""Bytes that are read of a file: far more than a number has."""


def devices(root: Path = DEVICES) -> list[Path]:
    """The folders of all devices, in the order of their numbers."""
    found = [path for path in root.glob("iio:device*") if _number(path) is not None]
    return sorted(found, key=lambda path: _number(path) or 0)


def read(folder: Path, name: str) -> bytes | None:
    """What the device's file holds now, None where there is none; raises QuadctlError.

    Never waits for a writer: a pipe that is put in a file's place reads as empty. While a sensor
    does not answer its driver the kernel may hold up the read, which nothing here can end; then
    the node is silent and the supervisor restarts it.
    """
    file = folder / name
    try:
        handle = os.open(file, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        try:
            return os.read(handle, _MOST)
        finally:
            os.close(handle)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise QuadctlError(
            f"{file} cannot be read: {error.strerror}", "look at the sensor and its driver"
        ) from error


def _number(path: Path) -> int | None:
    number = path.name.removeprefix("iio:device")
    return int(number) if number.isdecimal() else None
