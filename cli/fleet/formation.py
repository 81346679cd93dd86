"""Where each vehicle is to go, from the words of `fleet goto`. Pure."""

from collections.abc import Mapping, Sequence
from math import fsum

from schemas.geometry import Position
from services.runtime.errors import Invalid, UsageError
from services.runtime.named import nearest

_HINT = "fleet goto X Y Z | FORMATION [X Y Z] | VEHICLE=X,Y,Z ..; `quadctl fleet goto --help`"

Places = Mapping[str, Position]
"""A point for each vehicle, m."""


def named_goals(
    words: Sequence[str], names: Sequence[str], formations: Mapping[str, Places]
) -> dict[str, Position] | None:
    """The goals of `line 0 0 1` or `uav0=1,2,1`; None for `1 2 1`, which depends on where all are.

    Raises UsageError for words that are neither, Invalid for a name that there is not.
    """
    if all("=" in word for word in words):
        return dict(_own(word, names) for word in words)
    if _is_number(words[0]):
        return None
    title, *rest = words
    if title not in formations:
        known = f"the file has {', '.join(formations)}" if formations else "write one in a file"
        raise Invalid(f"there is no formation {title}", nearest(title, formations) or known)
    return _moved(formations[title], point(rest) if rest else Position(0.0, 0.0, 0.0))


def about(places: Places, to: Position) -> dict[str, Position]:
    """The places moved so that their centre is at a point, each as far from it as before."""
    count = len(places)
    x, y, z = (fsum(getattr(p, axis) for p in places.values()) / count for axis in "xyz")
    offsets = {name: Position(p.x - x, p.y - y, p.z - z) for name, p in places.items()}
    return _moved(offsets, to)


def point(words: Sequence[str]) -> Position:
    """Three numbers, m; raises UsageError for anything else."""
    if len(words) != 3 or not all(map(_is_number, words)):
        raise UsageError(f"'{' '.join(words)}' is no place: three numbers are", _HINT)
    x, y, z = map(float, words)
    return Position(x, y, z)


def _moved(places: Places, by: Position) -> dict[str, Position]:
    return {name: Position(by.x + p.x, by.y + p.y, by.z + p.z) for name, p in places.items()}


def _own(word: str, names: Sequence[str]) -> tuple[str, Position]:
    name, _, text = word.partition("=")
    if name not in names:
        hint = nearest(name, names) or f"the vehicles are {', '.join(names)}"
        raise Invalid(f"there is no vehicle {name}", hint)
    return name, point(text.split(","))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
