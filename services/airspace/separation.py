"""Separation: the space that each vehicle of a run reserves, and which two come too near.

Two vehicles are apart if (dx^2 + dy^2) / across^2 + dz^2 / tall^2 >= 1: an ellipsoid that is taller
than wide, because of the downwash. Distances here are in this measure: 1 is just apart.
"""

from collections.abc import Callable, Sequence
from enum import Enum

from msgspec import Struct

from quadctl.schemas.params import SeparationParams
from quadctl.services.airspace.geometry import Piece, Point, Space, distance

WIDER = 0.02
"""Metres by which ways keep farther away than vehicles must: each of two may stray by 10 mm."""
_ROUNDING = 1e-9


class How(Enum):
    """Why a space is reserved, after the name of its vehicle."""

    IS = "is too near the way"
    ENDS = "flies to a goal too near the way"
    FLIES = "flies too near the way"
    WAITS = "waits to fly there"


class Neighbour(Struct, frozen=True):
    """Another vehicle, and a space that it reserves; it `clears` one that it will leave by itself.

    It has to be `across` (m, horizontal) or `tall` (m, vertical) away.
    """

    name: str
    space: Space
    across: float
    tall: float
    how: How
    clears: bool


class Others:
    """Other vehicles of a run: `near` returns what those reserve that may come too near a space.

    What vehicles far from it reserve is not computed: there may be a thousand.
    """

    def __init__(self, near: Callable[[Space], Sequence[Neighbour]] | None = None) -> None:
        self.near: Callable[[Space], Sequence[Neighbour]] = near or (lambda _space: ())
        self._are_there = near is not None

    def __bool__(self) -> bool:
        """Return whether there may be any."""
        return self._are_there


NOBODY = Others()


def allowed(ours: SeparationParams, theirs: SeparationParams) -> tuple[float, float]:
    """Return how far apart two vehicles have to be, m: across and tall; 0, 0 if one has it off."""
    if not (ours.radius and theirs.radius):
        return 0.0, 0.0
    return ours.radius + theirs.radius, 0.5 * (ours.height + theirs.height)


def conflicts(place: Point, space: Space, others: Others) -> list[Neighbour]:
    """Return the vehicles that a way from a place (m) comes too near, in their order.

    A vehicle that is too near already may leave: its way must not bring it nearer. One too near a box in
    which another moves, or inside its space, may not: the other may be anywhere in it.
    """
    here = (Piece(place, place),)
    return [other for other in others.near(space) if _comes_near(here, space, other)]


def _comes_near(here: Space, space: Space, other: Neighbour) -> bool:
    across, tall = other.across, other.tall
    wide = across + WIDER, tall + WIDER
    if distance(space, other.space, *wide) >= 1:
        return False
    if distance(here, other.space, *wide) >= 1:
        return True
    least = min(distance(here, other.space, across, tall), 1.0)
    if least < _ROUNDING:
        return other.how is not How.IS
    if least < 1 and other.how is How.FLIES and any(piece.is_box for piece in other.space):
        return True
    return distance(space, other.space, across, tall) < least - _ROUNDING


def why_near(found: Sequence[Neighbour]) -> str:
    """Return the reason that names the first of the vehicles too near a way; empty without any."""
    return f"separation: {found[0].name} {found[0].how.value}" if found else ""
