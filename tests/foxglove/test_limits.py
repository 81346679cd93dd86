"""What one client of the bridge to Foxglove may not do to others, and in which order it acts."""

import signal
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial

import pytest
import zenoh
from msgspec import structs
from websockets.exceptions import InvalidStatus

import quadctl
from quadctl.schemas.messages import Position, SafetyState
from quadctl.services.runtime.bus import codec, session
from quadctl.services.runtime.bus.session import free_port
from quadctl.services.runtime.realm import Realm
from tests.support.foxglove import FoxgloveClient, bridge, bridged
from tests.support.lab import Lab
from tests.support.running import eventually

MOST = 50


@pytest.fixture(scope="module")
def run() -> Iterator[quadctl.Run]:
    with quadctl.launch() as run:
        yield run


@pytest.fixture(scope="module")
def port(run: quadctl.Run) -> Iterator[int]:
    port = free_port()
    with bridge(run.realm, port, "--control"):
        yield port


@pytest.mark.thorough
def test_a_goal_does_not_overtake_a_call_before_it(port: int, run: quadctl.Run):
    with FoxgloveClient(port) as client:
        publish = client.publish("/goto")
        for x in (1.0, 2.0, 3.0):
            publish(b'{"x": 0, "y": 0, "z": 1}')
            hold = client.request("uav/hold", b"{}")
            publish(b'{"x": %g, "y": 0, "z": 1}' % x)
            client.answer(hold)
            eventually(partial(goes_to, run, x))


def goes_to(run: quadctl.Run, x: float) -> bool:
    return run.vehicle.state().goal.x == x


@pytest.mark.thorough
def test_reads_that_wait_for_a_silent_node_hold_up_no_call(lab: Lab):
    lab.start()
    port = free_port()
    with bridged(lab, port, "--control"), FoxgloveClient(port) as client:
        lab.signal("pressure", signal.SIGSTOP)
        for number in range(20):
            client.send("getParameters", id=f"read {number}", parameterNames=[])
        assert client.call("uav/hold") == {"success": True}
        read = [each for each in client.documents if each["op"] == "parameterValues"]
        assert not read
        lab.signal("pressure", signal.SIGCONT)


def test_a_name_without_end_is_refused(port: int):
    with FoxgloveClient(port) as client:
        client.publish("/" + "x" * 300)
        client.document("status", lambda each: each["id"] == "topics")
        client.send("x" * 100_000)
        told = client.document("status", lambda each: each["id"] == "request")
        assert len(told["message"]) <= 1000


def test_watchers_do_not_keep_out_a_client_that_may_act(port: int):
    with ExitStack() as watchers:
        for _ in range(MOST):
            watchers.enter_context(FoxgloveClient(port, token="", reading=False))
        with pytest.raises(InvalidStatus) as refused:
            FoxgloveClient(port, token="", reading=False)
        assert refused.value.response.status_code == 503
        with FoxgloveClient(port) as pilot:
            assert pilot.call("uav/hold") == {"success": True}


def test_a_state_of_a_users_own_does_not_move_the_ground(port: int, run: quadctl.Run):
    state = structs.replace(run.vehicle.state(), goal=Position(0.0, 0.0, 4.0))
    payload, encoding = codec.encode(state), codec.encoding(SafetyState)
    with session.open_client(session.address_of(Realm(run.realm))) as bus:
        bus.put("uav/own/state", payload, encoding=encoding)
    with FoxgloveClient(port, everything=True) as client:
        client.wait(lambda: "uav/own/state" in client.channels)
        client.publish("/goto")(b'{"header": {}, "pose": {"position": {"x": 0.5, "y": 0, "z": 0}}}')
        eventually(lambda: run.vehicle.state().goal.x == 0.5)
        assert run.vehicle.state().goal.z < 2


@pytest.mark.thorough
def test_other_machines_need_a_certificate_however_the_bridge_is_started(lab: Lab):
    lab.start()
    command = [
        sys.executable,
        "-P",
        "-m",
        "quadctl.services.bridges.foxglove",
        "--realm",
        lab.realm,
    ]
    process = lab.spawn(*command, "--options", f'{{"host": "0.0.0.0", "port": {free_port()}}}')
    assert process.wait() == 2
    assert "--host 0.0.0.0 lets other machines watch" in process.log


@pytest.mark.thorough
def test_a_slow_client_loses_its_own_messages_only(port: int, run: quadctl.Run):
    count, pad = 3000, b"x" * 10_000
    with (
        session.open_client(session.address_of(Realm(run.realm))) as bus,
        FoxgloveClient(port) as quick,
        FoxgloveClient(port, reading=False) as slow,
    ):
        bus.put("uav/own/big", b'{"seq": -1}')
        quick.wait(lambda: "uav/own/big" in quick.channels)
        slow.subscribe_unread(quick.channels["uav/own/big"])
        quick.subscribe("uav/pose")
        quick.message("uav/pose")
        wait = zenoh.CongestionControl.BLOCK
        for number in range(count):
            payload = b'{"seq": %d, "pad": "%s"}' % (number, pad)
            bus.put("uav/own/big", payload, congestion_control=wait)
        # The bridge takes messages in their order; a pose of now comes after all of these.
        now = run.vehicle.pose().stamp + 1
        quick.message("uav/pose", lambda pose: pose["stamp"] > now)
        slow.read()
        slow.wait(lambda: slow.messages and slow.messages[-1].json["seq"] == count - 1)
        big = [each.json["seq"] for each in slow.messages]
        poses = [each.json["seq"] for each in quick.messages]
    assert len(big) < count
    assert big == sorted(big)
    assert poses == list(range(poses[0], poses[0] + len(poses)))


@pytest.mark.thorough
def test_a_flood_of_goals_leaves_room_for_calls_and_the_flight(port: int, run: quadctl.Run):
    run.vehicle.settle()  # a hold of an earlier test moves its goal until the vehicle rests
    before = run.vehicle.state()
    with FoxgloveClient(port) as client:
        publish = client.publish("/goto")
        for _ in range(10):
            for _ in range(500):
                publish(b'{"x": 99, "y": 0, "z": 1}')
            assert client.call("uav/toggle_cage", cage_on=True) == {"success": True}
    after = run.vehicle.state()
    assert 0 < after.request - before.request < 200
    assert after.goal == before.goal
    assert run.vehicle.goto(0, 0, 1, replace=True).distance < 0.5
