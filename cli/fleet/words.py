"""What the words of `fleet goto` say, as far as it is known before anybody is asked. Pure."""

from collections.abc import Sequence

from msgspec import Struct

from cli.declare import is_number
from cli.lab.goto import request_of
from schemas.messages import Position
from services.runtime.errors import UsageError

_HINT = "fleet goto X Y Z | FORMATION [X Y Z] | VEHICLE=X,Y,Z ..; `quadctl fleet goto --help`"


class Said(Struct, frozen=True):
    """Goals of vehicles by name, or a formation and where it is to be, or a centre alone; m."""

    own: dict[str, Position] = {}
    formation: str = ""
    at: Position = Position(0.0, 0.0, 0.0)


def read(words: Sequence[str]) -> Said:
    """`uav0=1,2,1`, `line 0 0 1` or `1 2 1`; raises UsageError, or Invalid for what is no place."""
    if all("=" in word for word in words):
        return Said(own=_own(words))
    if is_number(words[0]):
        return Said(at=_point(words))
    title, *rest = words
    return Said(formation=title, at=_point(rest)) if rest else Said(formation=title)


def _own(words: Sequence[str]) -> dict[str, Position]:
    goals: dict[str, Position] = {}
    for word in words:
        name, _, text = word.partition("=")
        if name in goals:
            raise UsageError(f"{name} is given two goals", "name each vehicle once")
        goals[name] = _point(text.split(","))
    return goals


def _point(words: Sequence[str]) -> Position:
    if len(words) != 3 or not all(map(is_number, words)):
        raise UsageError(f"'{' '.join(words)}' is no place: three numbers are", _HINT)
    x, y, z = map(float, words)
    # What no vehicle takes need not be asked of any.
    request_of(x, y, z, replace=False)
    return Position(x, y, z)
