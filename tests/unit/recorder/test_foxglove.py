"""Messages for viewers: the vehicle's frame and the cage, without repetition."""

from quadctl.schemas.messages import CageSize
from quadctl.services.recorder.foxglove import Scene
from tests.support.bags import BEGAN, pose, state


def test_the_frame_has_the_vehicles_place_and_the_recording_time():
    frame = Scene("uav3").frame(pose(7), BEGAN + 5)
    assert (frame.parent_frame_id, frame.child_frame_id) == ("world", "uav3")
    assert (frame.timestamp.sec, frame.timestamp.nsec) == (BEGAN // 10**9, 5)
    assert frame.translation.x == pose(7).position.x
    assert frame.rotation.w == 1.0


def test_the_cage_has_twelve_edges_between_its_eight_corners():
    update = Scene("uav").update(state(0.0, cage=CageSize(1.0, 2.0, 3.0)), BEGAN)
    assert update is not None
    (line,) = update.entities[0].lines
    edges = [{(p.x, p.y, p.z) for p in line.points[i : i + 2]} for i in range(0, 24, 2)]
    corners = {(x, y, z) for x in (-1, 1) for y in (-2, 2) for z in (0, 3)}
    assert set().union(*edges) == corners
    assert len({frozenset(edge) for edge in edges}) == 12
    for one, other in edges:
        assert sum(a != b for a, b in zip(one, other, strict=True)) == 1


def test_the_scene_is_drawn_again_only_after_a_change():
    scene = Scene("uav")
    assert scene.update(state(0.0), BEGAN) is not None
    assert scene.update(state(1.0, reason="busy", request=3), BEGAN) is None
    off = scene.update(state(2.0, cage_on=False), BEGAN)
    assert off is not None
    assert {entity.id for entity in off.entities} == {"uav/cage", "uav/goal", "uav/body"}
    assert scene.update(state(3.0, cage_on=False, cage=CageSize(1.0, 1.0, 1.0)), BEGAN) is not None
