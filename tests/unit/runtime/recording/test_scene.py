"""Messages for viewers: the vehicle's frame, the cage and the zones, without repetition."""

from quadctl.schemas.messages import CageSize, Position, Zone, Zones
from quadctl.schemas.zones import CircleParams, ZoneParams
from quadctl.services.runtime.recording.scene import MATCHING_ID, Drawing, Scene
from tests.support.bags import BEGAN, pose, state


def test_the_frame_has_the_vehicles_place_and_the_recording_time():
    frame = Scene("uav3").frame(pose(7), BEGAN + 5)
    assert (frame.parent_frame_id, frame.child_frame_id) == ("map", "uav3")
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


TOWER = ZoneParams("tower", polygon=((1.0, 0.0), (2.0, 0.0), (1.0, 1.0)), floor=0.5, ceiling=9.0)
POND = ZoneParams("pond", "inclusion", circle=CircleParams(-2.0, 1.0, 0.5))


def zones_of(update) -> list[str]:
    return [] if update is None else [e.id for e in update.entities if "/zone/" in e.id]


def test_a_polygon_has_its_edges_at_both_heights_and_a_circle_is_a_cylinder():
    scene = Scene("uav")
    assert scene.update(Zones((TOWER, POND)), BEGAN) is None, "the cage's height is unknown"
    update = scene.update(state(0.0, cage=CageSize(5.0, 5.0, 3.0)), BEGAN)
    assert update is not None
    tower, pond = update.entities[3:]
    (line,) = tower.lines
    edges = [
        frozenset((p.x, p.y, p.z) for p in line.points[i : i + 2])
        for i in range(0, len(line.points), 2)
    ]
    assert len(set(edges)) == len(edges) == 9
    corners = {(*corner, z) for corner in TOWER.polygon for z in (0.5, 9.0)}
    assert frozenset().union(*edges) == corners
    assert all(sum(corner in edge for edge in edges) == 3 for corner in corners)
    (cylinder,) = pond.cylinders
    at, size = cylinder.pose.position, cylinder.size
    assert (at.x, at.y, at.z) == (-2.0, 1.0, 1.5)
    assert (size.x, size.y, size.z) == (1.0, 1.0, 3.0)


def test_zones_are_drawn_again_only_after_a_change_and_removed_ones_are_deleted():
    scene = Scene("uav")
    scene.update(state(0.0), BEGAN)
    both, fewer = Zones((TOWER, POND)), Zones((POND,))
    assert zones_of(scene.update(both, BEGAN)) == ["uav/zone/tower", "uav/zone/pond"]
    assert scene.update(both, BEGAN) is None
    moved = scene.update(state(1.0, goal=Position(2.0, 0.0, 1.0)), BEGAN)
    assert moved is not None
    assert zones_of(moved) == []
    off = scene.update(state(2.0, cage_on=False), BEGAN)
    assert zones_of(off) == ["uav/zone/tower", "uav/zone/pond"]
    gone = scene.update(fewer, BEGAN + 7)
    assert gone is not None
    (deletion,) = gone.deletions
    assert (deletion.type, deletion.id) == (MATCHING_ID, "uav/zone/tower")
    assert deletion.timestamp.nsec == 7
    assert scene.update(fewer, BEGAN) is None


def test_a_late_viewer_gets_the_whole_scene_though_nothing_has_changed():
    drawing = Drawing("uav")
    assert drawing.whole(BEGAN) is None
    tower = ZoneParams("tower", "exclusion", circle=CircleParams(1.0, 1.0, 0.5))
    drawing.derive("uav/safety/zones", Zones((Zone.of(tower),)), BEGAN)
    first = drawing.derive("uav/safety/state", state(0.0), BEGAN)
    assert drawing.derive("uav/safety/state", state(0.0), BEGAN + 1) is None
    late = drawing.whole(BEGAN)
    assert first is not None
    assert late is not None
    assert late == first.message
    ids = {entity.id for entity in late.entities}
    assert ids == {"uav/cage", "uav/goal", "uav/body", "uav/zone/tower"}


def test_frames_are_those_of_the_fast_poses_once_there_are_some():
    drawing = Drawing("uav")
    assert drawing.derive("uav/pose/slow", pose(1), BEGAN) is not None
    assert drawing.derive("uav/pose", pose(1), BEGAN) is not None
    assert drawing.derive("uav/pose/slow", pose(2), BEGAN) is None
    assert drawing.derive("uav/sensors/pressure", None, BEGAN) is None
