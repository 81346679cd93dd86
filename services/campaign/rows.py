"""What happens in a mission: what is asked of safety, and what goes wrong. Times are simulated s."""

from typing import Any

from msgspec import Struct, structs

from schemas.params import SafetyParams


class Goto(Struct, frozen=True, tag=True):
    """A goal is asked for, m; it may be no place at all."""

    at: float
    x: float
    y: float
    z: float
    replace: bool


class Hold(Struct, frozen=True, tag=True):
    """A stop is asked for."""

    at: float


class Cage(Struct, frozen=True, tag=True):
    """The cage is turned on or off."""

    at: float
    on: bool


class Resize(Struct, frozen=True, tag=True):
    """The cage gets other bounds, m."""

    at: float
    x: float
    y: float
    z: float


class Range(Struct, frozen=True, tag=True):
    """The acceptance range gets another value, m."""

    at: float
    metres: float


class Deaf(Struct, frozen=True, tag=True):
    """For so long (s) no pose reaches safety."""

    at: float
    seconds: float


class Mute(Struct, frozen=True, tag=True):
    """For so long (s) no setpoint reaches the vehicle."""

    at: float
    seconds: float


class Jump(Struct, frozen=True, tag=True):
    """One pose says that the vehicle is elsewhere, by so much, m."""

    at: float
    x: float
    y: float
    z: float


class Late(Struct, frozen=True, tag=True):
    """A pose of some time ago (s) comes again, after newer ones."""

    at: float
    age: float


Row = Goto | Hold | Cage | Resize | Range | Deaf | Mute | Jump | Late


class Mission(Struct, frozen=True):
    """One flight: its seed, parameters at launch, start (m), mean wind (m/s, ENU) and rows in time."""

    seed: int
    seconds: float
    safety: SafetyParams
    start: tuple[float, float, float]
    wind: tuple[float, float]
    rows: tuple[Row, ...]


def text(row: Row) -> str:
    """A row as a line of a log shows it."""
    values: dict[str, Any] = structs.asdict(row)
    del values["at"]
    said = " ".join(
        f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}"
        for name, value in values.items()
    )
    return f"{type(row).__name__.lower()} {said}".rstrip()
