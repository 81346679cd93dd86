"""Real pressure sensor through Linux IIO.

Linux's Documentation/ABI/testing/sysfs-bus-iio: `in_pressure_input` is the pressure in kPa; drivers
without it have (`in_pressure_raw` + `in_pressure_offset`) x `in_pressure_scale`, also in kPa.
"""

import os
import re
from collections.abc import Callable
from pathlib import Path

from quadctl.schemas.barometer import AIR
from quadctl.services.runtime.errors import QuadctlError

DEVICES = Path("/sys/bus/iio/devices")
_MOST = 200
"""Bytes read from a file: far more than a number has."""


def devices(root: Path = DEVICES) -> list[Path]:
    """Return the folders of all devices, by number."""
    found = [path for path in root.glob("iio:device*") if _number(path) is not None]
    return sorted(found, key=lambda path: _number(path) or 0)


def read(folder: Path, name: str) -> bytes | None:
    """Return the content of the device's file, None if it is missing; raise QuadctlError.

    Never waits for a writer: a pipe in a file's place reads as empty. While a sensor does not
    answer its driver, the kernel may block the read, and this process cannot end that; then the
    node is silent and the supervisor restarts it.
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
            f"{file} cannot be read: {error.strerror}", "check the sensor and its driver"
        ) from error


def _number(path: Path) -> int | None:
    number = path.name.removeprefix("iio:device")
    return int(number) if number.isdecimal() else None


Read = Callable[[str], bytes | None]
"""Returns the content of a named file, None if it is missing; raises QuadctlError."""

INPUT, RAW = "in_pressure_input", "in_pressure_raw"
SCALE, OFFSET = "in_pressure_scale", "in_pressure_offset"

_NUMBER = re.compile(rb"-?\d+(\.\d+)?\n")
"""The kernel's format: the line end shows that the number is complete."""


def has_pressure(read: Read) -> bool:
    """Return whether a device has such a channel."""
    return read(INPUT) is not None or read(RAW) is not None


def hectopascals(folder: str, read: Read) -> float:
    """Return the pressure now, hPa. `folder` is the device's, for error messages.

    Raises QuadctlError if the value is missing, incomplete, not a number, or not an air pressure.
    """
    if (text := read(INPUT)) is not None:
        name, kilopascals = INPUT, _parsed(folder, INPUT, text)
    elif (text := read(RAW)) is not None:
        name, kilopascals = f"{RAW} with {SCALE}", _scaled(folder, read, text)
    else:
        raise QuadctlError(
            f"{folder} has neither {INPUT} nor {RAW}: no barometer, or unplugged",
            "plug it in, load its driver, or set pressure.iio to another folder",
        )
    hpa = 10 * kilopascals
    least, most = AIR
    if not least <= hpa <= most:
        raise QuadctlError(
            f"{folder}/{name} reads {kilopascals:g} kPa: air has {least / 10:g} to {most / 10:g}",
            "check the sensor and its driver; Linux defines this file in kPa",
        )
    return hpa


def _scaled(folder: str, read: Read, raw: bytes) -> float:
    scale, offset = read(SCALE), read(OFFSET)
    if scale is None:
        raise QuadctlError(
            f"{folder} has {RAW} but no {SCALE} to convert it",
            "check its driver, or set pressure.iio to another folder",
        )
    shift = 0.0 if offset is None else _parsed(folder, OFFSET, offset)
    return (_parsed(folder, RAW, raw) + shift) * _parsed(folder, SCALE, scale)


def _parsed(folder: str, name: str, text: bytes) -> float:
    if _NUMBER.fullmatch(text):
        return float(text)
    held = repr(text.decode(errors="replace")) if text else "nothing"
    raise QuadctlError(
        f"{folder}/{name} holds {held}: not one complete number and a line end",
        f"`cat {folder}/{name}` prints it; check the sensor and its driver",
    )
