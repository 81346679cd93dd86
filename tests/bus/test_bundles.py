"""Several vehicles of a run: between its processes one message a period, to others a topic each."""

import signal
import sys
from collections.abc import Iterator

import msgspec
import pytest

from tests.support.bare import Bare
from tests.support.lab import NODES, PATIENT, Lab, private_lab, sets
from tests.support.running import eventually

VEHICLES = ["uav0", "uav1", "uav2"]
BUNDLE = "uav0/@all/pose/slow"
ANSWERS = "uav0/@all/input/position"


@pytest.fixture(scope="module")
def fleet() -> Iterator[Lab]:
    """Three vehicles in the air."""
    with private_lab() as made:
        made.share(
            "--vehicles", 3, *sets("dynamics.start.z=1", "supervise.answer_timeout=60"), *PATIENT
        )
        yield made


def place_of(lab: Lab, vehicle: str) -> dict[str, float]:
    """Return where a vehicle is, m."""
    place: dict[str, float] = lab.quadctl("state", "--vehicle", vehicle, "--json").json["pose"][
        "position"
    ]
    return place


def fly_all(lab: Lab, height: float) -> None:
    """Assert that each vehicle flies to a height above its place."""
    for vehicle in VEHICLES:
        place = place_of(lab, vehicle)
        goal = place["x"], place["y"], height
        done = lab.quadctl("goto", *goal, "--vehicle", vehicle, "--json")
        assert (done.code, done.json["arrived"]) == (0, True), done.err


def is_full(bundle: tuple[int, int, list[tuple[str, dict[str, object], int]]]) -> bool:
    _process, _beats, parts = bundle
    return sorted(vehicle for vehicle, *_ in parts) == VEHICLES


@pytest.mark.parametrize("key", [BUNDLE, ANSWERS])
def test_messages_of_all_vehicles_go_out_as_one(fleet: Lab, key: str):
    places = {vehicle: place_of(fleet, vehicle) for vehicle in VEHICLES}
    with fleet.bare() as bare:
        watch = bare.watch(key)
        for height in (1.2, 1.7, 1.2):  # a loop that is busy at a tick sends alone
            for vehicle, place in places.items():
                goal = msgspec.msgpack.encode(place | {"z": height, "replace": True})
                assert bare.query(f"{vehicle}/@srv/goto", goal).value["accepted"]
            watch.until(is_full)


def test_vehicles_at_rest_send_no_poses_and_their_time_goes_on(fleet: Lab):
    with fleet.bare() as bare:
        resting = bare.watch(BUNDLE).until(lambda bundle: len(bundle[2]) == 1)
        assert resting[2][0][0] == "uav0"
        states = bare.watch("uav1/safety/state").next(3)
        stamps = [state["stamp"] for state in states]
        assert stamps[-1] - stamps[0] == pytest.approx(2.0, abs=0.5)
        # Whoever subscribes receives the true poses, in step with what safety has counted.
        [pose] = bare.watch("uav1/pose/slow").next()
        assert 0 <= pose["stamp"] - stamps[-1] < 5
        assert pose["seq"] == round(pose["stamp"] * 100)


def test_at_rest_the_barometer_still_has_a_seconds_readings(fleet: Lab):
    eventually(lambda: calibrated(fleet) == 10)


def calibrated(lab: Lab) -> int:
    """Calibrate a vehicle's barometer, and return the number of readings that it took."""
    assert lab.quadctl("calibrate", "--vehicle", "uav1").code == 0
    with lab.bare() as bare:
        [reading] = bare.watch("uav1/sensors/pressure").next()
    return int(reading["samples"])


def rest_all(lab: Lab, height: float) -> None:
    """Fly each vehicle to a height, and wait until all rest but the first one."""
    fly_all(lab, height)
    with lab.bare() as bare:
        bare.watch(BUNDLE).until(lambda bundle: len(bundle[2]) == 1)


@pytest.mark.thorough
def test_a_vehicle_at_rest_brakes_without_safety(fleet: Lab):
    rest_all(fleet, 1.2)
    before = fleet.log("dynamics").count("uav1: no setpoint for")
    with fleet.frozen("safety"):
        eventually(lambda: fleet.log("dynamics").count("uav1: no setpoint for") > before)
    fly_all(fleet, 1.3)


@pytest.mark.thorough
def test_no_goal_is_taken_for_a_vehicle_at_rest_that_sends_no_beats(fleet: Lab):
    rest_all(fleet, 1.2)
    goal = msgspec.msgpack.encode({"x": 0.0, "y": 0.0, "z": 1.5})
    with fleet.bare() as bare, fleet.frozen("dynamics"):
        eventually(lambda: "no pose" in bare.query("uav1/@srv/goto", goal).value["reason"])
    fly_all(fleet, 1.5)


def test_a_goal_where_a_vehicle_rests_is_reached_without_a_pause(fleet: Lab):
    with fleet.bare() as bare:
        states = bare.watch("uav1/safety/state")
        goal = msgspec.msgpack.encode(states.next()[0]["goal"])
        for _ in range(3):
            bare.watch(BUNDLE).until(lambda bundle: len(bundle[2]) == 1)
            states.next()
            assert bare.query("uav1/@srv/goto", goal).value["accepted"]
            states.until(lambda state: state["state"] == "MOVING")
            assert states.until(lambda state: state["state"] == "HOVERING")["reason"] == ""
    assert "no setpoint" not in fleet.log("safety")


@pytest.mark.thorough
@pytest.mark.parametrize("topic", ["pose", "pose/slow"])
def test_subscribers_that_come_and_go_cost_a_vehicle_at_rest_no_time(fleet: Lab, topic: str):
    def ahead() -> float:
        with fleet.bare() as bare:
            names = boots(bare)
            poses = bare.watch("*/pose/slow").next(30)
        stamps = {pose["boot"]: pose["stamp"] for pose in poses}
        return float(stamps[names["uav1"]] - stamps[names["uav0"]])

    before = ahead()
    for _ in range(20):
        with fleet.bare() as visitor:
            visitor.watch(f"uav1/{topic}").next(3)
        with fleet.bare() as bare:
            bare.watch(BUNDLE).until(lambda bundle: len(bundle[2]) == 1)
    # On a busy machine a visit may put its next tick forward, by less than a period.
    assert -0.15 < ahead() - before < 20 / 20


@pytest.mark.thorough
def test_each_flight_pauses_while_no_pose_comes(fleet: Lab):
    fly_all(fleet, 1.2)
    places = {vehicle: place_of(fleet, vehicle) for vehicle in VEHICLES}
    with fleet.bare() as bare:
        states = [bare.watch(f"{vehicle}/safety/state") for vehicle in VEHICLES]
        for vehicle, place in places.items():
            goal = msgspec.msgpack.encode(place | {"z": 1.9})
            assert bare.query(f"{vehicle}/@srv/goto", goal).value["accepted"]
        with fleet.frozen("dynamics"):
            for watch in states:
                watch.until(lambda state: state["reason"].startswith("paused: no pose"))
        for watch in states:
            watch.until(lambda state: state["state"] == "HOVERING" and not state["reason"])


def test_a_late_subscriber_receives_a_vehicles_own_topics_while_it_listens(fleet: Lab):
    for _ in range(2):
        with fleet.bare() as bare:
            poses = bare.watch("uav1/pose/slow").next(5)
            assert [pose["seq"] - poses[0]["seq"] for pose in poses] == [0, 5, 10, 15, 20]
            setpoints = bare.watch("uav1/input/position").next(5)
            assert {setpoint["boot"] for setpoint in setpoints} == {poses[0]["boot"]}


def test_a_subscriber_to_everything_receives_each_topic_and_no_bundle(fleet: Lab):
    seen: set[str] = set()
    wanted = {f"{v}/{topic}" for v in VEHICLES for topic in ("pose/slow", "input/position")}
    with fleet.bare() as bare:
        subscriber = bare.session.declare_subscriber("**", lambda s: seen.add(str(s.key_expr)))
        eventually(lambda: seen >= wanted)
        bare.watch(BUNDLE).next(3)
        subscriber.undeclare()
    assert not [key for key in seen if "@" in key]


def test_a_reset_of_one_vehicle_leaves_the_others_alone(fleet: Lab):
    fleet.put_back()
    with fleet.bare() as bare:
        before = boots(bare)
        assert fleet.quadctl("reset", "--vehicle", "uav1").code == 0
        after = boots(bare)
    assert {v for v in VEHICLES if before[v] != after[v]} == {"uav1"}
    fly_all(fleet, 1.4)


def boots(bare: Bare) -> dict[str, str]:
    """Return each vehicle's boot."""
    return {vehicle: bare.watch(f"{vehicle}/pose").next()[0]["boot"] for vehicle in VEHICLES}


@pytest.mark.parametrize("node", NODES)
def test_all_vehicles_fly_on_after_kill_9_of_a_process(fleet: Lab, node: str):
    fleet.put_back()
    old = fleet.signal(node, signal.SIGKILL)
    fleet.revived(node, old)
    fly_all(fleet, 1.6)
    with fleet.bare() as bare:
        bare.watch(BUNDLE).until(is_full)


def test_garbage_in_place_of_a_bundle_changes_nothing(fleet: Lab):
    with fleet.bare() as bare:
        for junk in (b"", b"\xc1", b"\x91\x01", b"\x93\xa4uav1\xc4\x01\xc1\x00"):
            bare.session.put(BUNDLE, junk)
            bare.session.put(ANSWERS, junk)
        # What follows a part that is no pose is read all the same.
        [pose] = bare.watch("uav2/pose/slow").next()
        late = "uav2", pose | {"boot": "another"}, 0
        bare.session.put(BUNDLE, msgspec.msgpack.encode((7, 1, [("uav1", {"x": 1}, 0), late])))
        bare.watch("uav2/safety/state").until(lambda state: state["boot"] == "another")
    eventually(lambda: "ignored a message on pose/slow" in fleet.log("safety"))
    fleet.put_back()
    fly_all(fleet, 1.2)
    assert "Traceback" not in fleet.log("safety") + fleet.log("dynamics")


OWN = """
import sys
import threading

import msgspec
import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", f'["{sys.argv[1]}"]')
with zenoh.open(config) as session:
    setpoints = session.declare_publisher("uav1/input/position")

    def on_pose(sample):
        pose = msgspec.msgpack.decode(sample.payload.to_bytes())
        goal = {"x": 0.0, "y": 0.0, "z": 1.5}
        answer = {"boot": pose["boot"], "for_seq": pose["seq"], "position": goal, "brake": False}
        setpoints.put(msgspec.msgpack.encode(answer))

    poses = session.declare_subscriber("uav1/pose/slow", on_pose)
    threading.Event().wait()
"""


def test_one_vehicles_safety_may_be_a_students(lab: Lab):
    lab.start("--vehicles", 2, "--without", "safety", "--set", "dynamics.start.z=1")
    endpoint = f"unixsock-stream/{lab.home / 'hub.sock'}"
    theirs = lab.spawn(sys.executable, "-c", OWN, endpoint)
    ours = lab.spawn(sys.executable, "-P", "-m", "quadctl.services.safety", "--vehicle", "uav0")
    eventually(lambda: lab.quadctl("goto", -1, -1, 1.5, "--vehicle", "uav0").code == 0)
    with lab.bare() as bare:
        there = bare.watch("uav1/pose").until(lambda pose: pose["position"]["z"] > 1.45)
        assert abs(there["position"]["x"]) < 0.1
    ours.end()
    theirs.end()
