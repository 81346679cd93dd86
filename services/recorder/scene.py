"""What viewers draw of a flight: the vehicle's frame, its body, the cage and the goal. Pure."""

from itertools import product

from schemas.messages import CageSize, Pose, Position, SafetyState
from services.recorder.foxglove import (
    LINE_LIST,
    Color,
    FrameTransform,
    Line,
    Placed,
    Rotation,
    SceneEntity,
    SceneUpdate,
    Solid,
    Time,
    Vector3,
)

WORLD = "world"
_ON, _OFF = Color(0.10, 0.50, 0.22, 0.9), Color(0.55, 0.58, 0.62, 0.5)
_GOAL = Color(0.12, 0.44, 0.92, 0.7)
_ARM, _NOSE = Color(0.15, 0.17, 0.20, 1.0), Color(0.81, 0.13, 0.18, 1.0)
_GOAL_SIZE = 0.15
"""Diameter of the goal's mark, m."""
_SPAN, _BEAM = 0.4, 0.03
"""How far the vehicle's arms reach from tip to tip, and how thick they are, m."""


class Scene:
    """What there is to draw of one vehicle; each thing again only when it has changed."""

    def __init__(self, vehicle: str) -> None:
        self._vehicle = vehicle
        self._drawn: tuple[CageSize, bool, Position] | None = None

    def frame(self, pose: Pose, at: int) -> FrameTransform:
        """Where the vehicle's body is, at a Unix time, ns."""
        p, q = pose.position, pose.orientation
        return FrameTransform(
            Time.of(at), WORLD, self._vehicle, Vector3(p.x, p.y, p.z), Rotation(q.x, q.y, q.z, q.w)
        )

    def update(self, state: SafetyState, at: int) -> SceneUpdate | None:
        """Body, cage and goal, where the state has other ones than the last; Unix time, ns."""
        now = (state.cage, state.cage_on, state.goal)
        if now == self._drawn:
            return None
        self._drawn = now
        outline = Line(
            LINE_LIST, Placed(), 2.0, True, _edges(state.cage), _ON if state.cage_on else _OFF
        )
        goal, size = state.goal, Vector3(_GOAL_SIZE, _GOAL_SIZE, _GOAL_SIZE)
        mark = Solid(Placed(Vector3(goal.x, goal.y, goal.z)), size, _GOAL)
        stamp, forever = Time.of(at), Time(0, 0)
        return SceneUpdate(
            [],
            [
                SceneEntity(stamp, WORLD, f"{self._vehicle}/cage", forever, False, lines=[outline]),
                SceneEntity(stamp, WORLD, f"{self._vehicle}/goal", forever, False, spheres=[mark]),
                SceneEntity(
                    stamp, self._vehicle, f"{self._vehicle}/body", forever, True, cubes=_body()
                ),
            ],
        )


def _edges(cage: CageSize) -> list[Vector3]:
    """The twelve edges of the cage, each as its two ends."""
    lows, highs = (-cage.x, -cage.y, 0.0), (cage.x, cage.y, cage.z)
    points = []
    for axis in range(3):
        for others in product(*((lows[i], highs[i]) for i in range(3) if i != axis)):
            for end in (lows[axis], highs[axis]):
                point = [*others[:axis], end, *others[axis:]]
                points.append(Vector3(*point))
    return points


def _body() -> list[Solid]:
    """Two beams crosswise, and a red nose, so that one sees where front is."""
    along, across = Vector3(_SPAN, _BEAM, _BEAM), Vector3(_BEAM, _SPAN, _BEAM)
    nose = Placed(Vector3(_SPAN / 2, 0.0, 0.0))
    return [
        Solid(Placed(), along, _ARM),
        Solid(Placed(), across, _ARM),
        Solid(nose, Vector3(2 * _BEAM, 2 * _BEAM, 2 * _BEAM), _NOSE),
    ]
