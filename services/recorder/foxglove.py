"""The messages by which Foxglove, Lichtblick and others draw in three dimensions. Pure.

Fields are theirs (https://docs.foxglove.dev/docs/visualization/message-schemas), m and rad. Shapes
that we do not draw are empty lists, which a reader expects to be there.
"""

from typing import Any

from msgspec import Struct, field

TRANSFORM, SCENE = "foxglove.FrameTransform", "foxglove.SceneUpdate"
LINE_LIST = 2
"""Of a line's types: points two by two."""
_SECOND = 1_000_000_000


class Time(Struct, frozen=True):
    """A Unix time."""

    sec: int
    nsec: int

    @classmethod
    def of(cls, nanoseconds: int) -> "Time":
        """From a Unix time in ns."""
        return cls(*divmod(nanoseconds, _SECOND))


class Vector3(Struct, frozen=True):
    """A point or a vector."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class Rotation(Struct, frozen=True):
    """A unit quaternion."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


class Placed(Struct, frozen=True):
    """A place and an attitude."""

    position: Vector3 = Vector3()
    orientation: Rotation = Rotation()


class Color(Struct, frozen=True):
    """Each from 0 to 1."""

    r: float
    g: float
    b: float
    a: float


class FrameTransform(Struct, frozen=True):
    """Where a frame is in another."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Rotation


class Solid(Struct, frozen=True):
    """A cube or a sphere."""

    pose: Placed
    size: Vector3
    color: Color


class Line(Struct, frozen=True):
    """Lines between points."""

    type: int
    pose: Placed
    thickness: float
    scale_invariant: bool
    points: list[Vector3]
    color: Color
    colors: list[Color] = field(default_factory=list)
    indices: list[int] = field(default_factory=list)


class SceneEntity(Struct, frozen=True):
    """A thing in a frame, until another of the same `id` takes its place."""

    timestamp: Time
    frame_id: str
    id: str
    lifetime: Time
    frame_locked: bool
    metadata: list[dict[str, str]] = field(default_factory=list)
    arrows: list[dict[str, Any]] = field(default_factory=list)
    cubes: list[Solid] = field(default_factory=list)
    spheres: list[Solid] = field(default_factory=list)
    cylinders: list[dict[str, Any]] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)
    triangles: list[dict[str, Any]] = field(default_factory=list)
    texts: list[dict[str, Any]] = field(default_factory=list)
    models: list[dict[str, Any]] = field(default_factory=list)


class SceneUpdate(Struct, frozen=True):
    """Things that are new or changed."""

    deletions: list[dict[str, Any]]
    entities: list[SceneEntity]
