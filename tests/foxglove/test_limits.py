"""What one client of the bridge to Foxglove may not do to others, and in which order it acts."""

import signal
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial

import pytest
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
    command = [sys.executable, "-P", "-m", "quadctl.services.foxglove", "--host", "0.0.0.0"]
    process = lab.spawn(*command, "--port", str(free_port()), "--realm", lab.realm)
    assert process.wait() == 2
    assert "--host 0.0.0.0 lets other machines watch" in process.log
