"""What every bridge promises to its clients and to the vehicle: one suite, which runs on each of them.

A promise that takes longer is kept by one bridge in `make test`, and by the others in `make test-rest`.
"""

import json
import random
import resource
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from math import dist
from typing import Any

import pytest
import zenoh

from quadctl.services.runtime.bus.session import free_port
from tests.bridges.sides import LIMIT, NAMES, Order, Side, sides
from tests.support import missions
from tests.support.bare import Bare, pack, speed
from tests.support.lab import NODES, PATIENT, Lab, private_lab
from tests.support.running import eventually

GROWTH = 16 << 20
"""Bytes by which the memory of a bridge may grow, whatever its clients do."""
GOALS, BURST, PAUSE = 30_000, 100, 0.01
"""Goals of a flood, in all and in a row, and seconds between two rows: up to 10 000 goals a second."""


def mainly(first: str, *others: str) -> pytest.MarkDecorator:
    """Run a test on one bridge in `make test`, and on others in `make test-rest`."""
    rest = [pytest.param(each, marks=pytest.mark.thorough) for each in others]
    return pytest.mark.parametrize("bridge", [first, *rest], indirect=True)


def place(pose: Any) -> tuple[float, ...]:
    return tuple(pose["position"][axis] for axis in "xyz")


def arrive(vehicle: Bare, *goal: float) -> None:
    """Wait until the vehicle hovers at a place."""
    poses, states = vehicle.watch("uav/pose"), vehicle.watch("uav/safety/state")
    poses.until(lambda pose: dist(place(pose), goal) < 0.05 and speed(pose) < 0.01)
    states.until(lambda state: state["state"] == "HOVERING")


def test_the_labs_checkpoints_are_flown_and_shown_as_by_our_own_commands(
    side: Side, vehicle: Bare, bridged_lab: Lab
):
    assert side.order("calibrate").done
    assert vehicle.watch("uav/sensors/pressure").next()[0]["baseline"] > 1000
    for on, order in ((False, "cage off"), (True, "cage on")):
        assert side.order(order).done
        assert vehicle.state()["cage_on"] is on
    assert side.order((1.0, 2.0, 1.5)) == (True, "")
    arrive(vehicle, 1.0, 2.0, 1.5)
    shown = bridged_lab.quadctl("state", "--json").json
    assert dist(side.pose(), place(shown["pose"])) < 0.01
    side.await_state(shown)


def test_a_goal_outside_is_refused_with_the_reason_and_moves_nothing(side: Side, vehicle: Bare):
    before = vehicle.state()
    refused = side.order((9.0, 0.0, 1.0))
    assert not refused.done
    after = vehicle.state()
    assert (after["state"], after["goal"]) == ("HOVERING", before["goal"])
    assert after["reason"].startswith("outside the cage: x = ")
    assert after["reason"] in refused.reason
    assert dist(side.pose(), (0.0, 0.0, 1.0)) < 0.05


def test_orders_are_carried_out_as_they_were_sent(side: Side, vehicle: Bare):
    orders: list[Order] = []
    for number in range(1, 6):
        orders += [(number / 10, 0.0, 1.0), "hold", "cage off", (0.0, number / 10, 1.0), "cage on"]
    executed = vehicle.watch_calls("*")
    for order in [*orders, "hold"]:
        side.send(order)
    side.order((0.0, 0.0, 1.5))
    executed.until(lambda call: call["request"].get("z") == pytest.approx(1.5))
    # Of a goal x and y, of a change of the cage whether it is on, of a stop nothing.
    fields = {"hold": [], "cage off": [False], "cage on": [True]}
    wanted = [fields[each] if isinstance(each, str) else [*each[:2]] for each in [*orders, "hold"]]
    found = [
        [
            round(call["request"][name], 2)
            for name in ("x", "y", "cage_on")
            if name in call["request"]
        ]
        for call in executed.messages
    ]
    assert found == [*wanted, [0.0, 0.0]]


def test_a_parameter_is_read_and_set_or_refused_with_the_reason(side: Side, bridged_lab: Lab):
    assert side.limit() == 0.5
    assert side.set_limit(0.375).done
    assert side.limit() == 0.375
    assert bridged_lab.quadctl("param", "get", LIMIT).out == "0.375\n"
    refused = side.set_limit(-1.0)
    assert not refused.done
    assert "expected" in refused.reason
    assert side.limit() == 0.375


@mainly("ros2", "foxglove", "mavlink")
def test_garbage_by_the_thousand_changes_nothing(side: Side, vehicle: Bare):
    executed, noise = vehicle.watch_calls("*"), random.Random(7)
    for _ in range(2000):
        side.send_garbage(noise)
    eventually(lambda: side.order("hold").done)
    eventually(lambda: executed.messages)
    assert {tuple(call["request"]) for call in executed.messages} == {()}


@contextmanager
def flood(send: Callable[[int], object]) -> Iterator[Callable[[], int]]:
    """Send messages by their number during the block; yield a function that returns how many it were."""
    sent, ended = 0, threading.Event()

    def run() -> None:
        nonlocal sent
        # As fast as can be, it would be a test of a machine without a free processor.
        while not ended.wait(PAUSE):
            for _ in range(BURST):
                send(sent)
                sent += 1

    with ThreadPoolExecutor(1) as pool:
        flooded = pool.submit(run)
        try:
            yield lambda: sent
        finally:
            ended.set()
    flooded.result()


@mainly("foxglove", "mavlink", "ros2")
def test_a_flood_of_goals_delays_no_stop_and_the_newest_is_flown(side: Side, vehicle: Bare):
    before, newest = side.memory, (1.0, 1.0, 1.0)
    with flood(lambda number: side.send((number % 400 / 100, 0.0, 1.0))) as sent:
        while sent() < GOALS:
            assert side.order("hold").done

    def is_in_force() -> bool:
        side.send(newest)  # again, as the datagrams of a flood may be lost
        return dist(vehicle.state()["goal"].values(), newest) < 0.05

    eventually(is_in_force)
    arrive(vehicle, *newest)
    assert side.memory - before < GROWTH


@mainly("ros2", "foxglove", "mavlink")
def test_while_safety_is_silent_poses_come_and_orders_fail_with_the_reason(
    side: Side, bridged_lab: Lab
):
    with bridged_lab.frozen("safety") as pid:
        side.pose()
        failed = side.order("hold")
        assert not failed.done, (pid, bridged_lab.nodes(), bridged_lab.log("up"))
        assert "uav/@srv/hold" in failed.reason
        side.pose()
    eventually(lambda: side.order("hold").done)


@mainly("mavlink", "foxglove", "ros2")
def test_a_read_that_waits_for_a_silent_node_delays_no_order(side: Side, bridged_lab: Lab):
    with ThreadPoolExecutor() as pool, bridged_lab.frozen("pressure"):

        def waits() -> Future[float] | None:
            # A bridge may know the parameters for a second.
            read = pool.submit(side.limit)
            return None if wait([read], 0.5).done else read

        waiting = eventually(waits)
        assert waiting is not None
        assert side.order("hold").done
        assert not waiting.done()
    assert waiting.result() == 0.5


@mainly("foxglove", "mavlink", "ros2")
def test_a_killed_bridge_leaves_the_flight_alone_and_the_next_one_serves(
    bridge: Side, vehicle: Bare
):
    with bridge.connect():
        assert bridge.order((4.0, 0.0, 1.0)).done
        vehicle.watch("uav/pose").until(lambda pose: speed(pose) > 1)
        bridge.process.send(signal.SIGKILL)
        bridge.process.wait()
    arrive(vehicle, 4.0, 0.0, 1.0)
    bridge.start()
    with bridge.connect():
        assert dist(bridge.pose(), (4.0, 0.0, 1.0)) < 0.1
        assert bridge.order((3.0, 0.0, 1.0)).done
    arrive(vehicle, 3.0, 0.0, 1.0)


@mainly("mavlink", "foxglove", "ros2")
@pytest.mark.parametrize("node", ["safety", "hub"])
def test_a_bridge_goes_on_by_itself_when_a_killed_node_is_back(
    side: Side, bridged_lab: Lab, node: str
):
    bridged_lab.revived(node, bridged_lab.signal(node, signal.SIGKILL))
    side.pose()
    assert side.order((1.0, 0.0, 1.0)).done
    assert not side.process.ended
    # The next test finds the run whole, too: every node has joined the new hub.
    eventually(lambda: {*NODES} <= {each["name"] for each in nodes(bridged_lab)})


def nodes(lab: Lab) -> list[dict[str, Any]]:
    return list(lab.quadctl("node", "list", "--json").json or [])


# ROS has no rights of its own: whoever reaches its router may act.
@mainly("foxglove", "mavlink")
def test_a_client_without_the_token_or_key_may_only_watch(bridge: Side, vehicle: Bare):
    executed = vehicle.watch_calls("*")
    with bridge.guarded():
        with bridge.connect(may_act=False):
            for order in ((1.0, 0.0, 1.0), "cage off", "calibrate"):
                bridge.send(order)
                assert dist(bridge.pose(), (0.0, 0.0, 1.0)) < 0.05
        with bridge.connect():
            assert bridge.order("hold").done
    eventually(lambda: executed.messages)
    assert [call["request"] for call in executed.messages] == [{}]


# MAVLink has one client, and waits for nothing that it should read. On a run of its own: the states come
# faster than the other bridges pass them on, which would be sent to the clients of a later test.
@pytest.mark.parametrize("name", ["ros2", pytest.param("foxglove", marks=pytest.mark.thorough)])
def test_a_client_that_reads_nothing_delays_no_other(lab: Lab, name: str):
    lab.start("--set", "dynamics.start.z=1", *PATIENT)
    wait = zenoh.CongestionControl.BLOCK
    with sides(lab) as side_of, lab.bare() as vehicle, (side := side_of(name)).connect():
        side.pose()
        before, state = side.memory, vehicle.state()
        with side.deaf():
            for number in range(10_000):
                # As long as can be; viewers are sent more than twice the bytes.
                told = f"{number}".ljust(1000)
                state |= {"reason": told, "goal": {"x": number % 2, "y": 0, "z": 1}}
                vehicle.session.put("uav/safety/state", pack(state), congestion_control=wait)
            side.await_state(state)
            assert side.order("hold").done
        assert side.memory - before < GROWTH


@pytest.fixture
def many_files(bridge: Side) -> Iterator[None]:
    """Let the test open thousands of files, and the bridge as many as in a usual shell."""
    usual, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.prlimit(bridge.process.pid, resource.RLIMIT_NOFILE, (1024, most))
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (usual, most))


@mainly("ros2", "foxglove", "mavlink")
def test_a_thousand_that_only_begin_keep_nobody_out(bridge: Side, many_files: None):
    with bridge.connect():
        bridge.pose()
    before = bridge.memory
    with bridge.half_open(1000), bridge.connect():
        bridge.pose()
        eventually(lambda: bridge.order("hold").done)
    eventually(lambda: bridge.memory - before < GROWTH)


@pytest.fixture(scope="module")
def fast() -> Iterator[tuple[Lab, Callable[[str], Side]]]:
    """Run of a mission's flights at ten times their speed, and its bridges."""
    with private_lab() as lab:
        missions.start(lab, "dynamics.speed=10")
        with sides(lab) as side_of:
            yield lab, side_of


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES)
def test_the_flight_is_the_same_whatever_happens_to_the_bridge(
    fast: tuple[Lab, Callable[[str], Side]], name: str
):
    lab, side = fast[0], fast[1](name)
    flown, noise = {"alone": missions.fly(lab)}, random.Random(7)
    with side.connect():
        side.pose()
        flown["read"] = missions.fly(lab)
        with flood(lambda _: side.send_garbage(noise)):
            flown["flooded"] = missions.fly(lab)
        for how, number in (("frozen", signal.SIGSTOP), ("killed", signal.SIGKILL)):
            side.process.send(number)
            flown[how] = missions.fly(lab)
    alone = missions.same(flown["alone"])
    assert {how: missions.same(each) for how, each in flown.items()} == dict.fromkeys(flown, alone)


@pytest.fixture(scope="module")
def secured() -> Iterator[Callable[[str], Side]]:
    """Run behind a gate, with bridges that have the certificate of a student."""
    with private_lab() as lab:
        for words in ("init", "issue hub", "issue student anna --vehicle uav"):
            assert lab.quadctl("keys", *words.split()).code == 0
        hub = f"tls/127.0.0.1:{free_port()}"
        lab.start("--listen", hub, "--identity", "keys/hub")
        with sides(lab, "--connect", hub, "--identity", "keys/anna", "--json") as side_of:
            yield side_of


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES)
def test_a_bridge_has_the_rights_of_its_certificate(secured: Callable[[str], Side], name: str):
    side = secured(name)
    with side.connect():
        side.pose()
        assert side.order("hold").done
        refused = side.order("cage off")
    assert not refused.done
    assert refused.reason.startswith("not allowed: a student of uav may not call")
    printed = side.process.log.splitlines()[0]
    assert json.loads(printed)["vehicles"] == ["uav"]
    assert all(word in printed for word in side.network if not word.startswith("--"))
