"""Foxglove messages, and the scene built from them. Pure.

Fields follow https://docs.foxglove.dev/docs/visualization/message-schemas, in m and rad. Shapes
that are not drawn are empty lists, because readers expect the fields.
"""

from itertools import product
from typing import Any

from msgspec import Struct, field

from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState

TRANSFORM, SCENE = "foxglove.FrameTransform", "foxglove.SceneUpdate"
LINE_LIST = 2
"""Line type in which each pair of points is a separate line."""
_SECOND = 1_000_000_000


class Time(Struct, frozen=True):
    """A Unix time."""

    sec: int
    nsec: int

    @classmethod
    def of(cls, nanoseconds: int) -> "Time":
        """Convert a Unix time in ns."""
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
    """A position and an attitude."""

    position: Vector3 = Vector3()
    orientation: Rotation = Rotation()


class Color(Struct, frozen=True):
    """Red, green, blue and opacity, each from 0 to 1."""

    r: float
    g: float
    b: float
    a: float


class FrameTransform(Struct, frozen=True):
    """Pose of a frame in its parent frame."""

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
    """An object in a frame; a later one with the same `id` replaces it."""

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
    """Objects that are new or changed."""

    deletions: list[dict[str, Any]]
    entities: list[SceneEntity]


WORLD = "world"
_ON, _OFF = Color(0.10, 0.50, 0.22, 0.9), Color(0.55, 0.58, 0.62, 0.5)
_GOAL = Color(0.12, 0.44, 0.92, 0.7)
_ARM, _NOSE = Color(0.15, 0.17, 0.20, 1.0), Color(0.81, 0.13, 0.18, 1.0)
_GOAL_SIZE = 0.15
"""Diameter (m) of the goal's marker."""
_SPAN, _BEAM = 0.4, 0.03
"""Length of the vehicle's arms from tip to tip, and their thickness, m."""


class Scene:
    """Drawing of one vehicle; each object is sent again only when it has changed."""

    def __init__(self, vehicle: str) -> None:
        self._vehicle = vehicle
        self._drawn: tuple[CageSize, bool, Position] | None = None

    def frame(self, pose: Pose, at: int) -> FrameTransform:
        """Return the frame of the vehicle's body at a Unix time, ns."""
        p, q = pose.position, pose.orientation
        return FrameTransform(
            Time.of(at), WORLD, self._vehicle, Vector3(p.x, p.y, p.z), Rotation(q.x, q.y, q.z, q.w)
        )

    def update(self, state: SafetyState, at: int) -> SceneUpdate | None:
        """Return body, cage and goal at a Unix time (ns), or None if they have not changed."""
        now = (state.cage, state.cage_on, state.goal)
        if now == self._drawn:
            return None
        self._drawn = now
        colour = _ON if state.cage_on else _OFF
        outline = Line(LINE_LIST, Placed(), 2.0, True, _edges(state.cage), colour)
        goal, size = state.goal, Vector3(_GOAL_SIZE, _GOAL_SIZE, _GOAL_SIZE)
        mark = Solid(Placed(Vector3(goal.x, goal.y, goal.z)), size, _GOAL)
        stamp, forever, name = Time.of(at), Time(0, 0), self._vehicle
        entities = [
            SceneEntity(stamp, WORLD, f"{name}/cage", forever, False, lines=[outline]),
            SceneEntity(stamp, WORLD, f"{name}/goal", forever, False, spheres=[mark]),
            SceneEntity(stamp, name, f"{name}/body", forever, True, cubes=_body()),
        ]
        return SceneUpdate([], entities)


def _edges(cage: CageSize) -> list[Vector3]:
    """Return the twelve edges of the cage, each as its two ends."""
    lows, highs = (-cage.x, -cage.y, 0.0), (cage.x, cage.y, cage.z)
    points = []
    for axis in range(3):
        for others in product(*((lows[i], highs[i]) for i in range(3) if i != axis)):
            for end in (lows[axis], highs[axis]):
                point = [*others[:axis], end, *others[axis:]]
                points.append(Vector3(*point))
    return points


def _body() -> list[Solid]:
    """Return two crossed beams, and a red nose that marks the front."""
    along, across = Vector3(_SPAN, _BEAM, _BEAM), Vector3(_BEAM, _SPAN, _BEAM)
    front, nose = Placed(Vector3(_SPAN / 2)), Vector3(2 * _BEAM, 2 * _BEAM, 2 * _BEAM)
    return [Solid(Placed(), along, _ARM), Solid(Placed(), across, _ARM), Solid(front, nose, _NOSE)]
