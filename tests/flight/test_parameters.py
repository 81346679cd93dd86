"""`param set` takes effect at once, validates, sets all or nothing, and survives a restart."""

import signal
from collections.abc import Iterator
from itertools import pairwise

import pytest

from tests.support.bare import Bare, gap, speed
from tests.support.lab import PATIENT, Lab, private_lab
from tests.support.running import eventually


@pytest.fixture(scope="module")
def tuned() -> Iterator[Lab]:
    """System whose vehicle is slow: a flight lasts longer than a command on a busy machine."""
    with private_lab() as made:
        made.share(
            "--set", "dynamics.start.z=1", "--set", "dynamics.control.max_speed=0.3",
            "--set", "dynamics.grace=5", *PATIENT,
        )  # fmt: skip
        yield made


@pytest.fixture
def session(tuned: Lab) -> Iterator[Bare]:
    with tuned.put_back_session() as bare:
        yield bare


def test_a_smaller_cage_takes_effect_at_once(tuned: Lab, session: Bare):
    assert session.call("goto", x=4.0, y=0.0, z=1.0).value["accepted"]
    done = tuned.quadctl("param", "set", "safety.virtual_cage.x", 3, "--json")
    assert (done.code, done.json) == (0, {"safety.virtual_cage.x": 3})
    # When the command returns, the flight to the goal, now outside, has been stopped.
    state = session.state()
    assert (state["state"], state["cage"]["x"]) == ("HOVERING", 3)
    assert "x = 4" in state["reason"]
    assert tuned.quadctl("cage", "show", "--json").json["x"] == [-3, 3]
    refused = session.call("goto", x=4.0, y=0.0, z=1.0).value
    assert "[-3, 3]" in refused["reason"]


def test_a_vehicle_outside_a_shrunk_cage_hovers_and_may_return(tuned: Lab, session: Bare):
    assert session.call("hold").ok
    poses = session.watch("uav/pose")
    place = poses.until(lambda p: speed(p) < 0.01)["position"]
    assert place["z"] > 0.9
    assert tuned.quadctl("param", "set", "safety.virtual_cage.z=0.5").code == 0
    assert session.state()["state"] == "HOVERING"
    assert max(gap(pose["position"], place) for pose in poses.next(30)) < 0.05
    assert "beyond [0, 0.5]" in session.call("goto", **place).value["reason"]
    mark = len(poses.messages)
    back = tuned.quadctl("goto", place["x"], place["y"], 0.2, "--json")
    assert (back.code, back.json["arrived"]) == (0, True), back
    heights = [pose["position"]["z"] for pose in poses.messages[mark:]]
    assert all(now <= before + 1e-3 for before, now in pairwise(heights))


def test_a_bad_value_changes_nothing_even_beside_good_ones(tuned: Lab, session: Bare):
    before = session.call("safety/get_params", names=[]).value
    for words in (
        ("safety.virtual_cage.x", "nan"),
        ("safety.virtual_cage.x", "-3"),
        ("safety.virtual_cage.z", "0.1"),
        ("safety.virtual_cage.y=3", "safety.virtual_cage.x=wide"),
        ("safety.virtual_cage.y=3", "safety.virtual_cage.q=3"),
    ):
        done = tuned.quadctl("param", "set", *words, "--json")
        assert (done.code, done.out, done.error["code"]) == (6, "", "invalid")
    assert session.call("safety/get_params", names=[]).value == before


@pytest.mark.parametrize(
    ("words", "said", "hint"),
    [
        ("safety.virtual_cage.x -3", ">= 0.2", "`quadctl param describe safety.virtual_cage.x`"),
        ("safety.virtual_cage 3", "expected `object`", "param describe safety.virtual_cage`"),
        ("safety.virtual_cage.xx 3", "did you mean safety.virtual_cage.x?", "`quadctl param list`"),
        ("safety.cage_on true", "fixed at launch", "`quadctl cage on`"),
        ("dynamics.speed 0", "fixed at launch", "`quadctl up --set dynamics.speed=0`"),
    ],
)
def test_a_refused_value_comes_with_a_hint(tuned: Lab, words: str, said: str, hint: str):
    error = tuned.quadctl("param", "set", *words.split(), "--json").error
    assert said in error["message"]
    assert hint in error["hint"]


def test_param_set_cannot_turn_the_cage_on_or_off(tuned: Lab, session: Bare):
    assert tuned.quadctl("cage", "off").code == 0
    try:
        for words in ("safety.cage_on true", "safety.takeoff=2 safety.cage_on=true"):
            done = tuned.quadctl("param", "set", *words.split())
            assert (done.code, done.out) == (6, "")
        assert not session.state()["cage_on"]
        assert tuned.quadctl("param", "get", "safety.takeoff").out == "1.0\n"
    finally:
        assert tuned.quadctl("cage", "on").code == 0
    assert tuned.quadctl("param", "set", "safety.cage_on=false").code == 6
    assert session.state()["cage_on"]
    assert "Change:   at launch" in tuned.quadctl("param", "describe", "safety.cage_on").out


@pytest.mark.thorough
def test_a_table_may_be_written_as_toml_json_or_ros_yaml(tuned: Lab, session: Bare):
    for number, text in enumerate(("{ x = %s }", "{x: %s, y: 4}", '{"x": %s.0, "y": 4.0}'), 2):
        cage = text % number
        assert tuned.quadctl("param", "set", "safety.virtual_cage", cage).code == 0
        assert session.state()["cage"]["x"] == number
    assert tuned.quadctl("param", "set", 'safety.virtual_cage={"x":4.5,"z":4}').code == 0
    assert session.state()["cage"] == {"x": 4.5, "y": 4.0, "z": 4.0}
    done = tuned.quadctl("param", "set", "safety.virtual_cage", "{x: 3, q: 4}")
    assert (done.code, "q" in done.err) == (6, True)


@pytest.mark.thorough
def test_parameter_names_may_be_written_as_in_ros(tuned: Lab, session: Bare):
    names = tuned.quadctl("param", "list").out.splitlines()
    of_safety = [name for name in names if name.startswith("safety.")]
    lines = {f"param list {name}": of_safety for name in ("safety", "/safety", "/uav/safety")}
    lines |= {"param list /": names, "param list safety.takeoff": ["safety.takeoff"]}
    for line, done in tuned.each(lines).items():
        assert (done.code, done.out.splitlines()) == (0, lines[line])
    assert sorted(tuned.quadctl("param", "get", "/", "--json").json) == names
    assert tuned.quadctl("param", "get", "/uav/safety/virtual_cage/x").out == "5.0\n"
    assert tuned.quadctl("param", "set", "/uav/safety/takeoff", 1).out == "safety.takeoff: 1\n"
    assert tuned.quadctl("param", "describe", "/uav/safety/takeoff").code == 0
    told = tuned.each(["param list saftey", "param set / 3", "param set /=3"])
    assert [done.code for done in told.values()] == [6, 2, 2]
    assert "did you mean safety?" in told["param list saftey"].err


def test_several_parameters_are_set_together_and_survive_a_kill(tuned: Lab, session: Bare):
    words = ("safety.virtual_cage.x=3", "/safety/virtual_cage/y=2.5")
    assert tuned.quadctl("param", "set", *words).code == 0
    old = tuned.signal("safety", signal.SIGKILL)
    tuned.revived("safety", old)
    shown = tuned.quadctl("cage", "show", "--json").json
    assert (shown["x"], shown["y"], shown["z"]) == ([-3, 3], [-2.5, 2.5], [0, 5])
    got = tuned.quadctl("param", "get", "safety.virtual_cage").out
    assert "safety.virtual_cage.y: 2.5" in got.splitlines()


@pytest.mark.thorough
def test_rate_and_speed_limit_change_while_in_use(session: Bare):
    assert session.call("pressure/set_params", values={"pressure.rate": 50}).value["success"]
    stamps = [r["stamp"] for r in session.watch("uav/sensors/pressure").next(40)[10:]]
    assert (stamps[-1] - stamps[0]) / (len(stamps) - 1) == pytest.approx(0.02, abs=0.01)
    limit = {"dynamics.control.max_speed": 0.5}
    assert session.call("dynamics/set_params", values=limit).value["success"]
    eventually(lambda: "in_force" not in session.call("dynamics/get_params", names=[]).value)
    poses = session.watch("uav/pose")
    assert session.call("goto", x=-2.0, y=0.0, z=1.0, replace=True).value["accepted"]
    poses.until(lambda p: speed(p) > 0.4)
    assert max(speed(pose) for pose in poses.next(50)) < 0.7


def test_a_limit_set_in_flight_is_reported_as_waiting(tuned: Lab, session: Bare):
    assert session.call("goto", x=2.0, y=0.0, z=1.0, replace=True).value["accepted"]
    session.watch("uav/pose").until(lambda p: speed(p) > 0.2)
    name = "dynamics.control.max_acceleration"
    done = tuned.quadctl("param", "set", name, "0.5")
    assert (done.code, done.out) == (0, f"{name}: 0.5 (from the next standstill)\n")
    told = tuned.quadctl("param", "get", name)
    assert (told.code, told.out) == (0, "0.5\n")
    assert told.err == f"{name}: 5.0 is in force until the next standstill\n"
    told = tuned.quadctl("param", "get", name, "dynamics.wind.gust", "--json")
    assert told.json == {name: 0.5, "dynamics.wind.gust": 0.0, "in_force": {name: 5.0}}
    done = tuned.quadctl("param", "set", "dynamics.wind.gust=0.1", f"{name}=0.6", "--json")
    assert done.json == {"dynamics.wind.gust": 0.1, name: 0.6, "waits": [name]}
    assert "Change:   at a standstill" in tuned.quadctl("param", "describe", name).out
    assert session.call("hold").ok
    values = {name: 5.0, "dynamics.wind.gust": 0.0}
    assert session.call("dynamics/set_params", values=values).value == {
        "success": True, "reason": "",
    }  # fmt: skip


def test_a_vehicle_that_would_not_fly_is_refused(tuned: Lab, session: Bare):
    for words, said in (
        ("dynamics.vehicle.motor_lag 0.5", "unstable"),
        ("dynamics.vehicle.mass 4", "its motors lift 8.32 m/s^2 at most"),
        ("dynamics.wind.mean.x=12 dynamics.control.max_tilt=0.8", "wind of 12 m/s"),
        ("dynamics.vehicle.mass 2.1", "no promise holds so far from the lab's vehicle"),
        ("safety.acceptance_range 1e-12", "less than the vehicle can hold, 0.0063 m"),
    ):
        done = tuned.quadctl("param", "set", *words.split())
        assert (done.code, done.out) == (6, "")
        assert said in done.err
    assert "in_force" not in session.call("dynamics/get_params", names=[]).value
    started = tuned.quadctl("up", "--realm", "other", "--set", "dynamics.vehicle.motor_lag=0.5")
    assert (started.code, "unstable" in started.err) == (6, True)


def test_each_node_judges_by_the_values_that_the_other_has_now(tuned: Lab, session: Bare):
    assert tuned.quadctl("param", "set", "safety.max_speed", "3").code == 0
    refused = tuned.quadctl("param", "set", "dynamics.control.max_speed", "5")
    assert (refused.code, "safety.max_speed: 3 m/s is less" in refused.err) == (6, True)
    assert tuned.quadctl("param", "set", "safety.max_speed", "30").code == 0
    words = ("dynamics.control.max_speed=15", "dynamics.vehicle.drag=0")
    assert tuned.quadctl("param", "set", *words).code == 0
    refused = tuned.quadctl("param", "set", "safety.max_speed", "10")
    assert (refused.code, "the vehicle may reach" in refused.err) == (6, True)


def test_limits_beyond_the_body_are_accepted_and_told(tuned: Lab, session: Bare):
    assert session.call("hold").ok
    name = "dynamics.control.max_acceleration"
    done = tuned.quadctl("param", "set", name, "20")
    assert (done.code, "can do 6.3 m/s^2, flown with 5.7" in done.err) == (0, True)
    assert tuned.quadctl("param", "set", name, "5").err == ""


@pytest.mark.thorough
def test_a_wind_beyond_the_envelope_lands_the_vehicle(tuned: Lab, session: Bare):
    assert tuned.quadctl("goto", 0, 0, 1, "--replace").code == 0
    done = tuned.quadctl("param", "set", "dynamics.wind.mean.x", "10")
    assert (done.code, "cannot hold itself: wind of 10 m/s" in done.err) == (0, True)
    why = "stopped and landing, it cannot hold itself: wind of 10 m/s"
    eventually(lambda: session.state()["reason"].startswith(why))
    poses = session.watch("uav/pose")
    landed = poses.until(lambda p: p["position"]["z"] < 0.01 and speed(p) < 0.01)["position"]
    refused = tuned.quadctl("goto", 1, 1, 1)
    assert (refused.code, "the vehicle lands: it cannot hold" in refused.err) == (5, True)
    assert gap(poses.next(1)[0]["position"], landed) < 0.2
    assert "stopped and landing, no goal is taken" in tuned.log("dynamics")
    assert tuned.quadctl("param", "set", "dynamics.wind.mean.x", "0").code == 0
    assert tuned.quadctl("goto", landed["x"], landed["y"], 1).code == 0


@pytest.mark.thorough
@pytest.mark.parametrize(("timeout", "pauses"), [(0.3, True), (5.0, False)])
def test_a_patience_for_setpoints_set_live_is_safetys_too(
    tuned: Lab, session: Bare, timeout: float, *, pauses: bool
):
    name = "dynamics.setpoint_timeout"
    assert tuned.quadctl("param", "set", name, timeout).code == 0
    poses = session.watch("uav/pose")
    # Far enough for a flight of several seconds, wherever the vehicle is.
    far = -2.0 if poses.next(1)[0]["position"]["x"] > 0 else 2.0
    assert session.call("goto", x=far, y=0.0, z=1.0, replace=True).value["accepted"]
    # It turns round, so safety has seen it fly to this goal.
    start = poses.until(lambda p: p["velocity"]["x"] * far > 0.2)
    with tuned.frozen("safety"):
        poses.until(lambda p: p["stamp"] > start["stamp"] + 0.7)
    went_on = "went on after a pause: the vehicle received no setpoint"
    mark = poses.messages[-1]["stamp"]
    poses.until(lambda p: p["stamp"] > mark + 0.5)
    assert session.state()["reason"].startswith(went_on) is pauses


def test_a_launch_tells_of_limits_beyond_the_body():
    with private_lab() as lab:
        done = lab.quadctl("up", "-d", "--set", "dynamics.control.max_acceleration=20")
        line = "max_acceleration 20: the body can do 6.3 m/s^2, flown with 5.7\n"
        assert (done.code, done.err.startswith(line)) == (0, True)
        eventually(lambda: line in lab.log("dynamics"))


def test_an_unknown_parameter_is_named_in_the_error(tuned: Lab, session: Bare):
    done = tuned.quadctl("param", "set", "safety.cage", "3", "--json")
    assert done.code == 6
    assert "safety.cage" in done.error["message"]
