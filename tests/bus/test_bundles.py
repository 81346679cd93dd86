"""Several vehicles of a run: between its processes one message a period, to others a topic each."""

import signal
import sys
from collections.abc import Iterator

import msgspec
import pytest

from tests.support.bare import Bare
from tests.support.lab import NODES, PATIENT, Lab, private_lab
from tests.support.running import eventually

VEHICLES = ["uav0", "uav1", "uav2"]
BUNDLE = "uav0/@all/pose/slow"
ANSWERS = "uav0/@all/input/position"


@pytest.fixture(scope="module")
def fleet() -> Iterator[Lab]:
    """Three vehicles in the air."""
    with private_lab() as made:
        made.share("--vehicles", 3, "--set", "dynamics.start.z=1", *PATIENT)
        yield made


def fly_all(lab: Lab, height: float) -> None:
    """Assert that each vehicle flies to a height above its place."""
    for vehicle in VEHICLES:
        place = lab.quadctl("state", "--vehicle", vehicle, "--json").json["pose"]["position"]
        goal = place["x"], place["y"], height
        done = lab.quadctl("goto", *goal, "--vehicle", vehicle, "--json")
        assert (done.code, done.json["arrived"]) == (0, True), done.err


def is_full(bundle: tuple[int, int, list[tuple[str, dict[str, object], int]]]) -> bool:
    _process, _beats, parts = bundle
    return sorted(vehicle for vehicle, *_ in parts) == VEHICLES


@pytest.mark.parametrize("key", [BUNDLE, ANSWERS])
def test_messages_of_all_vehicles_go_out_as_one(fleet: Lab, key: str):
    with fleet.bare() as bare:
        watch = bare.watch(key)
        for _ in range(3):  # a loop that is busy at a tick sends alone
            watch.until(is_full)


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
