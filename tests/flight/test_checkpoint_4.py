"""Checkpoint 4: a service turns the cage on and off; its reply is true in every situation."""

from tests.support.bare import Bare, gap, speed
from tests.support.lab import Lab

OUTSIDE = {"x": 6.0, "y": 0.0, "z": 1.0}


def test_a_goal_outside_is_refused_then_reached_with_the_cage_off(shared_lab: Lab, hover: Bare):
    assert shared_lab.quadctl("goto", 6, 0, 1).code == 5
    off = shared_lab.quadctl("cage", "off", "--json")
    assert (off.code, off.json) == (0, {"success": True})
    flown = shared_lab.quadctl("goto", 6, 0, 1, "--json")
    assert (flown.code, flown.json["arrived"]) == (0, True)

    on = shared_lab.quadctl("cage", "on")
    assert on.code == 0
    assert shared_lab.quadctl("cage", "show", "--json").json["on"]
    poses = hover.watch("uav/pose")
    outside = poses.until(lambda p: speed(p) < 0.02)["position"]
    assert outside["x"] > 5
    assert hover.call("goto", **OUTSIDE).value["accepted"] is False
    assert "x = 6" in hover.state()["reason"]
    # Outside after a command it hovers in place, and every step of the way back comes nearer.
    assert max(gap(pose["position"], outside) for pose in poses.next(50)) < 0.05
    back = shared_lab.quadctl("goto", 4.5, 0, 1, "--json")
    assert (back.code, back.json["arrived"]) == (0, True)
    beyond = [p["position"]["x"] for p in poses.messages if p["position"]["x"] > 5]
    assert max(beyond) < outside["x"] + 0.05


def test_turning_the_cage_on_stops_a_flight_to_a_goal_outside(shared_lab: Lab, hover: Bare):
    states, poses = hover.watch("uav/safety/state"), hover.watch("uav/pose")
    hover.call("toggle_cage", cage_on=False)
    far = {"x": -9.0, "y": 0.0, "z": 1.0}
    assert hover.call("goto", **far).value["accepted"]
    poses.until(lambda p: speed(p) > 1)
    assert hover.call("toggle_cage", cage_on=True).value == {"success": True}
    # The reply comes after the effect: never (cage on, MOVING, goal outside).
    now = hover.state()
    assert (now["state"], now["cage_on"]) == ("HOVERING", True)
    assert "x = -9" in now["reason"]
    poses.until(lambda p: speed(p) < 0.02)
    rest = poses.next()[0]["position"]
    assert -5 < rest["x"] < 0
    assert not [s for s in states.messages if s["cage_on"] and s["state"] == "MOVING"]
    assert hover.call("goto", x=0.0, y=0.0, z=1.0).value["accepted"]


def test_turning_the_cage_on_keeps_a_flight_to_a_goal_inside(hover: Bare):
    states = hover.watch("uav/safety/state")
    hover.call("toggle_cage", cage_on=False)
    assert hover.call("goto", x=-4.0, y=0.0, z=1.0).value["accepted"]
    assert hover.call("toggle_cage", cage_on=True).value == {"success": True}
    states.until(lambda s: s["state"] == "MOVING" and s["cage_on"])
    end = states.until(lambda s: s["state"] == "HOVERING")
    assert (end["goal"]["x"], end["reason"]) == (-4.0, "")


def test_cage_on_reports_the_flight_it_stopped_and_nothing_older(shared_lab: Lab, hover: Bare):
    hover.call("toggle_cage", cage_on=False)
    assert hover.call("goto", **OUTSIDE).value["accepted"]
    hover.watch("uav/pose").until(lambda p: speed(p) > 0.5)
    stopped = shared_lab.quadctl("cage", "on").out.splitlines()
    assert stopped[0] == "cage is on"
    assert len(stopped) == 2
    assert "x = 6" in stopped[1]
    # The old reason stays in the state, but the next toggles must not report it again.
    assert hover.state()["reason"] == stopped[1]
    for word, said in (("on", "cage is on\n"), ("off", "cage is off\n"), ("on", "cage is on\n")):
        assert shared_lab.quadctl("cage", word).out == said


def test_cage_show_prints_the_bounds_and_the_service_turns_it_off(shared_lab: Lab, hover: Bare):
    shown = shared_lab.quadctl("cage", "show")
    assert shown.out.splitlines() == [
        "cage is on",
        "cage x - [-5.0, 5.0]",
        "cage y - [-5.0, 5.0]",
        "cage z - [0.0, 5.0]",
    ]
    assert shared_lab.quadctl("service", "call", "toggle_cage", "cage_on=false").code == 0
    assert not hover.state()["cage_on"]


def test_a_takeoff_above_the_cage_leaves_the_vehicle_on_the_ground(lab: Lab):
    lab.start("--set", "safety.virtual_cage.z=0.5")
    with lab.bare() as bare:
        state = bare.state()
        assert (state["state"], state["request"]) == ("HOVERING", 1)
        assert "z = 1" in state["reason"]
        heights = [p["position"]["z"] for p in bare.watch("uav/pose").next(30)]
        assert max(heights) < 0.01
        assert bare.call("goto", x=0.0, y=0.0, z=0.4).value["accepted"]
