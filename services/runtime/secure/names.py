"""Whose certificates are good: the list that `quadctl keys` keeps and the gate reads."""

import re
from pathlib import Path

import msgspec

from services.runtime.errors import Invalid, UsageError
from services.runtime.realm import vehicle_name, write_atomically
from services.runtime.secure.name import Name

LIST = "names.json"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}")


def checked(name: str) -> str:
    """A holder's name, which also names a folder; raises UsageError for what cannot be one."""
    if not _NAME.fullmatch(name):
        raise UsageError(
            f"'{name}' is no name for a certificate",
            "use at most 40 letters, digits, '_' or '-', the first a letter or digit",
        )
    return name


def checked_vehicles(said: list[str]) -> list[str]:
    """The vehicles that a role is for, all where none is said; raises UsageError."""
    return sorted({vehicle_name(vehicle) for vehicle in said}) or ["*"]


def load(folder: Path) -> list[Name]:
    """The list of a folder; raises UsageError where there is none, Invalid where it is none."""
    file = folder / LIST
    try:
        return msgspec.json.decode(file.read_bytes(), type=list[Name])
    except FileNotFoundError as error:
        raise UsageError(
            f"{file} is not there", "`quadctl keys init` makes a fleet's keys, `keys issue` a hub's"
        ) from error
    except OSError as error:
        raise UsageError(f"{file} cannot be read: {error.strerror}") from error
    except msgspec.DecodeError as error:
        raise Invalid(f"{file} is no list of names: {error}", "`quadctl keys list` reads it") from (
            error
        )


def save(folder: Path, names: list[Name]) -> None:
    """Write the list; raises OSError."""
    write_atomically(folder / LIST, msgspec.json.format(msgspec.json.encode(names)) + b"\n")
