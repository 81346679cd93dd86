"""Real pressure sensor through Linux IIO.

Linux's Documentation/ABI/testing/sysfs-bus-iio: `in_pressure_input` is the pressure in kPa; a
driver that leaves the arithmetic to its reader has (`in_pressure_raw` + `in_pressure_offset`) x
`in_pressure_scale` instead, also kPa.
"""

import os
import re
from collections.abc import Callable
from pathlib import Path

from quadctl.schemas.barometer import AIR
from quadctl.services.runtime.errors import QuadctlError

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


Read = Callable[[str], bytes | None]
"""What the file of a name holds, None where there is none; raises QuadctlError."""

INPUT, RAW = "in_pressure_input", "in_pressure_raw"
SCALE, OFFSET = "in_pressure_scale", "in_pressure_offset"

_NUMBER = re.compile(rb"-?\d+(\.\d+)?\n")
"""As the kernel writes it: the end of the line tells that the number is whole."""


def has_pressure(read: Read) -> bool:
    """Whether a device has such a channel."""
    return read(INPUT) is not None or read(RAW) is not None


def hectopascals(folder: str, read: Read) -> float:
    """The pressure now, hPa. `folder` is the device's, for what is said of it.

    Raises QuadctlError for what is missing, no number, torn, or cannot be the air's pressure.
    """
    if (text := read(INPUT)) is not None:
        said, kilopascals = INPUT, _parsed(folder, INPUT, text)
    elif (text := read(RAW)) is not None:
        said, kilopascals = f"{RAW} with {SCALE}", _scaled(folder, read, text)
    else:
        raise QuadctlError(
            f"{folder} has neither {INPUT} nor {RAW}: no barometer, or one that is gone",
            "plug it in, load its driver, or name another folder in pressure.iio",
        )
    hpa = 10 * kilopascals
    least, most = AIR
    if not least <= hpa <= most:
        raise QuadctlError(
            f"{folder}/{said} says {kilopascals:g} kPa: the air has {least / 10:g} to {most / 10:g}",
            "look at the sensor and its driver; by Linux's rules the file is in kPa",
        )
    return hpa


def _scaled(folder: str, read: Read, raw: bytes) -> float:
    scale, offset = read(SCALE), read(OFFSET)
    if scale is None:
        raise QuadctlError(
            f"{folder} has {RAW} but no {SCALE}, without which it says nothing",
            "look at its driver, or name another folder in pressure.iio",
        )
    shift = 0.0 if offset is None else _parsed(folder, OFFSET, offset)
    return (_parsed(folder, RAW, raw) + shift) * _parsed(folder, SCALE, scale)


def _parsed(folder: str, name: str, text: bytes) -> float:
    if _NUMBER.fullmatch(text):
        return float(text)
    held = repr(text.decode(errors="replace")) if text else "nothing"
    raise QuadctlError(
        f"{folder}/{name} holds {held}: not one whole number and the end of the line",
        f"`cat {folder}/{name}` shows it now; look at the sensor and its driver",
    )
