"""Foxglove messages, and the scene built from them, for recordings and live viewers. Pure.

Fields follow https://docs.foxglove.dev/docs/visualization/message-schemas, in m and rad. Shapes
that are not drawn are empty lists, because readers expect the fields.
"""

from itertools import product
from typing import Any, NamedTuple

from msgspec import Struct, field, structs

from quadctl.schemas.earth import WORLD
from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState, Zone, Zones
from quadctl.schemas.topics import POSE
from quadctl.schemas.zones import FARTHEST, edges_of

TRANSFORM, SCENE = "foxglove.FrameTransform", "foxglove.SceneUpdate"
FRAMES_KEY, SCENE_KEY = "/tf", "/scene"
"""Topics that viewers look for; no Zenoh key begins with a slash."""
LINE_LIST = 2
"""Line type in which each pair of points is a separate line."""
MATCHING_ID = 0
"""Deletion type of the one object with its id."""
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


class Cylinder(Struct, frozen=True):
    """An upright cylinder; the scales are 1, less for a cone."""

    pose: Placed
    size: Vector3
    bottom_scale: float
    top_scale: float
    color: Color


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
    cylinders: list[Cylinder] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)
    triangles: list[dict[str, Any]] = field(default_factory=list)
    texts: list[dict[str, Any]] = field(default_factory=list)
    models: list[dict[str, Any]] = field(default_factory=list)


class SceneEntityDeletion(Struct, frozen=True):
    """Removal of an object."""

    timestamp: Time
    type: int
    id: str


class SceneUpdate(Struct, frozen=True):
    """Objects that are gone, and those that are new or changed."""

    deletions: list[SceneEntityDeletion]
    entities: list[SceneEntity]


_ON, _OFF = Color(0.10, 0.50, 0.22, 0.9), Color(0.55, 0.58, 0.62, 0.5)
_GOAL = Color(0.12, 0.44, 0.92, 0.7)
_ZONES = {"exclusion": Color(0.81, 0.13, 0.18, 0.9), "inclusion": _ON}
_FILLED = 0.25
"""Opacity of a cylinder beside that of a line."""
_ARM, _NOSE = Color(0.15, 0.17, 0.20, 1.0), Color(0.81, 0.13, 0.18, 1.0)
_GOAL_SIZE = 0.15
"""Diameter (m) of the goal's marker."""
_SPAN, _BEAM = 0.4, 0.03
"""Length of the vehicle's arms from tip to tip, and their thickness, m."""


class Derived(NamedTuple):
    """Message made for viewers from one of the bus, with its key and its name among theirs."""

    key: str
    name: str
    message: FrameTransform | SceneUpdate


class Drawing:
    """Frames and scene of one vehicle, derived from its messages."""

    def __init__(self, vehicle: str) -> None:
        self._vehicle, self._scene = vehicle, Scene(vehicle)
        self.state: SafetyState | None = None
        """Newest state, once there is one."""
        self._zones = Zones(())
        self._fast = False

    def derive(self, key: str, message: Struct | None, at: int) -> Derived | None:
        """Return what viewers need from a message that came at a Unix time (ns), if anything."""
        if isinstance(message, Pose):
            self._fast = self._fast or key == POSE.key(self._vehicle)
            if self._fast and key != POSE.key(self._vehicle):
                return None  # a slow pose, which is one of the others
            return Derived(FRAMES_KEY, TRANSFORM, self._scene.frame(message, at))
        if isinstance(message, SafetyState):
            self.state = message
        elif isinstance(message, Zones):
            self._zones = message
        else:
            return None
        update = self._scene.update(message, at)
        return Derived(SCENE_KEY, SCENE, update) if update else None

    def whole(self, at: int) -> SceneUpdate | None:
        """Return the whole scene, for a viewer that is late; None before the first state."""
        if self.state is None:
            return None
        scene = Scene(self._vehicle)
        scene.update(self._zones, at)
        return scene.update(self.state, at)


class Scene:
    """Objects of one vehicle; each object is sent again only when it has changed."""

    def __init__(self, vehicle: str) -> None:
        self._vehicle = vehicle
        self._drawn: tuple[CageSize, bool, Position] | None = None
        self._zones: tuple[Zone, ...] = ()
        self._fenced: tuple[CageSize, bool, tuple[Zone, ...]] | None = None

    def frame(self, pose: Pose, at: int) -> FrameTransform:
        """Return the frame of the vehicle's body at a Unix time, ns."""
        p, q = pose.position, pose.orientation
        return FrameTransform(
            Time.of(at), WORLD, self._vehicle, Vector3(p.x, p.y, p.z), Rotation(q.x, q.y, q.z, q.w)
        )

    def update(self, message: SafetyState | Zones, at: int) -> SceneUpdate | None:
        """Return what a message changes in the scene at a Unix time (ns), or None for nothing.

        Zones wait for the first state: the cage is their height if they have no ceiling.
        """
        if isinstance(message, Zones):
            self._zones, entities = message.zones, []
        else:
            entities = self._room(message, at)
        gone, columns = self._columns(at)
        entities += columns
        return SceneUpdate(gone, entities) if gone or entities else None

    def _room(self, state: SafetyState, at: int) -> list[SceneEntity]:
        """Return body, cage and goal, or nothing if they have not changed."""
        now = (state.cage, state.cage_on, state.goal)
        if now == self._drawn:
            return []
        self._drawn = now
        colour = _ON if state.cage_on else _OFF
        outline = Line(LINE_LIST, Placed(), 2.0, True, _edges(state.cage), colour)
        goal, size = state.goal, Vector3(_GOAL_SIZE, _GOAL_SIZE, _GOAL_SIZE)
        mark = Solid(Placed(Vector3(goal.x, goal.y, goal.z)), size, _GOAL)
        stamp, forever, name = Time.of(at), Time(0, 0), self._vehicle
        return [
            SceneEntity(stamp, WORLD, f"{name}/cage", forever, False, lines=[outline]),
            SceneEntity(stamp, WORLD, f"{name}/goal", forever, False, spheres=[mark]),
            SceneEntity(stamp, name, f"{name}/body", forever, True, cubes=_body()),
        ]

    def _columns(self, at: int) -> tuple[list[SceneEntityDeletion], list[SceneEntity]]:
        """Return the zones that are gone and those in force, or nothing if none has changed."""
        if self._drawn is None:
            return [], []
        cage, on, _ = self._drawn
        before, self._fenced = self._fenced, (cage, on, self._zones)
        if before == self._fenced:
            return [], []
        stamp, forever = Time.of(at), Time(0, 0)
        ids = {self._zone_id(zone): zone for zone in self._zones}
        known = [self._zone_id(zone) for zone in before[2]] if before else []
        entities = []
        for id_, zone in ids.items():
            edges, filled = _column(zone, cage, _ZONES[zone.kind] if on else _OFF)
            entities.append(
                SceneEntity(stamp, WORLD, id_, forever, False, lines=edges, cylinders=filled)
            )
        gone = [SceneEntityDeletion(stamp, MATCHING_ID, id_) for id_ in known if id_ not in ids]
        return gone, entities

    def _zone_id(self, zone: Zone) -> str:
        return f"{self._vehicle}/zone/{zone.name}"


def _column(zone: Zone, cage: CageSize, colour: Color) -> tuple[list[Line], list[Cylinder]]:
    """Return the edges over a polygon, or the cylinder over a circle, from the ground upwards."""
    low = max(zone.floor, 0.0)
    high = max(cage.z if zone.ceiling == FARTHEST else zone.ceiling, low)
    if not zone.polygon:
        circle = zone.circle
        centre = Placed(Vector3(circle.x, circle.y, (low + high) / 2))
        size = Vector3(2 * circle.radius, 2 * circle.radius, high - low)
        filled = structs.replace(colour, a=_FILLED * colour.a)
        return [], [Cylinder(centre, size, 1.0, 1.0, filled)]
    points = [
        Vector3(*corner)
        for ax, ay, bx, by in edges_of(zone.polygon)
        for corner in (
            (ax, ay, low), (bx, by, low), (ax, ay, high), (bx, by, high), (ax, ay, low), (ax, ay, high),
        )
    ]  # fmt: skip
    return [Line(LINE_LIST, Placed(), 2.0, True, points, colour)], []


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
