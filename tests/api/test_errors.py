"""What leaves the API is a quadctl.Error with a hint: wrong arguments, and use after the end."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import quadctl
from quadctl.schemas.services import GotoRequest
from quadctl.schemas.topics import GOTO, POSE, STATE
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.run_files import read
from quadctl.services.runtime.supervisor.control import stop_run
from tests.support.running import DEADLINE, alive, eventually

FAST = {"dynamics.speed": 0}
ENDLESS: list[Any] = []
ENDLESS.append(ENDLESS)
Use = Callable[[Any], object]


@pytest.fixture(scope="module")
def run() -> Iterator[quadctl.Run]:
    with quadctl.launch(params=FAST) as started:
        started.vehicle.settle()
        yield started


@pytest.mark.parametrize(
    "arguments",
    [
        {"config": 5}, {"config": "no/such.toml"}, {"params": [1]}, {"params": {1: 2}},
        {"params": {"safety": 5}}, {"params": {"safety.takeoff": 1j}}, {"params": {"": 1}},
        {"vehicles": "2"}, {"vehicles": True}, {"vehicles": 2.5}, {"vehicles": 0}, {"realm": 5},
        {"realm": "../x"}, {"processes": ["x"]}, {"processes": {"safety": 5}}, {"record": 5},
        {"record": "no/such/x.mcap"}, {"timeout": "x"}, {"timeout": -1}, {"timeout": float("nan")},
        {"config": "\0"}, {"config": "\ud800"}, {"record": ""}, {"record": "a" * 300},
        {"params": False}, {"params": {"\ud800": 1}}, {"params": {"hub.transport": "\ud800"}},
        {"params": {"hub.listen": ENDLESS}}, {"realm": 0.0},
    ],
    ids=str,
)  # fmt: skip
def test_a_wrong_argument_of_a_launch_starts_nothing(arguments: dict[str, Any]):
    with pytest.raises(quadctl.Error) as raised:
        quadctl.launch(**arguments)
    assert raised.value.hint


@pytest.mark.parametrize(
    "arguments",
    [
        {"realm": 5},
        {"realm": 0.0},
        {"vehicle": [1]},
        {"connect": 5},
        {"connect": "nonsense"},
        {"timeout": None},
    ],
    ids=str,
)
def test_a_wrong_argument_of_a_connection_is_refused(arguments: dict[str, Any]):
    with pytest.raises(quadctl.Error) as raised:
        quadctl.connect(**arguments)
    assert raised.value.hint


@pytest.mark.parametrize("file", [5, None, "/", "no/such.mcap", "a\0b", "\ud800", "a" * 300])
def test_what_is_no_recording_is_refused(file: Any):
    with pytest.raises(quadctl.Invalid) as raised:
        quadctl.read(file)
    assert raised.value.hint


WRONG: dict[str, Use] = {
    "a text as a coordinate": lambda quad: quad.goto("a", 1, 1),
    "a text as a switch": lambda quad: quad.goto(1, 1, 1, replace="x"),
    "a text as a time": lambda quad: quad.goto(1, 1, 1, timeout="x"),
    "no time to settle": lambda quad: quad.settle(timeout=0),
    "a number as a topic": lambda quad: quad.watch(5),
    "an unknown topic": lambda quad: quad.watch("nope"),
    "a text as a watch's time": lambda quad: quad.watch("pose", seconds="x"),
    "a number as a parameter": lambda quad: quad.params[5],
    "an unknown parameter": lambda quad: quad.params["nope"],
    "a list of parameters": lambda quad: quad.params.update([1]),
    "an object as a value": lambda quad: quad.params.update({"safety.takeoff": object()}),
    "a text as a value": lambda quad: quad.params.update({"safety.takeoff": "x"}),
    "a text as the cage's switch": lambda quad: quad.cage(on="yes"),
    "a text as a service": lambda quad: quad.client.call("goto", 5),
    "a number as a request": lambda quad: quad.client.call(GOTO, 5),
    "a text as a latched topic": lambda quad: quad.client.latest("state"),
    "a topic that is not latched": lambda quad: quad.client.latest(POSE),
    "a text as a topic": lambda quad: quad.client.first("pose"),
    "a text as a server to wait for": lambda quad: quad.client.wait_for_server("goto"),
    "a topic as a key": lambda quad: quad.client.listen(POSE),
    "a topic as a key to publish": lambda quad: quad.client.raw_publisher(POSE),
    "a key with an empty part": lambda quad: quad.client.listen("a//b"),
    "a key with a mark": lambda quad: quad.client.raw_publisher("a#b"),
    "keys to replay": lambda quad: quad.client.stage({"a//b": ""}),
    "nothing as a payload": lambda quad: quad.client.raw_publisher("own/x").put(None),
    "a text as a call's time": lambda quad: quad.client.call(GOTO, GotoRequest(0, 0, 1), "x"),
    "a time of a call that is over": lambda quad: quad.client.call(GOTO, GotoRequest(0, 0, 1), -1),
    "half a character": lambda quad: quad.params.update({"safety.takeoff": "\ud800"}),
    "a list in itself": lambda quad: quad.params.update({"hub.listen": ENDLESS}),
    "a decimal number": lambda quad: quad.goto(Decimal(1), 0, 1),
    "no vehicle": lambda quad: quadctl.Client(quad.client.realm.name, 3),  # type: ignore[arg-type]
    "a text to subscribe to": lambda quad: quad.client.subscribe("pose"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_argument_is_an_error_with_a_hint(run: quadctl.Run, wrong: str):
    with pytest.raises(quadctl.Error) as raised:
        WRONG[wrong](run.vehicle)
    assert raised.value.hint


def test_the_name_of_a_topic_where_a_topic_is_due_says_so(run: quadctl.Run):
    with pytest.raises(quadctl.Invalid, match="'state' is no Topic") as raised:
        run.vehicle.client.latest("state")  # type: ignore[arg-type]
    assert "e.g. STATE of quadctl.schemas.topics" in raised.value.hint


def test_an_unknown_vehicle_is_a_key_error_that_names_the_others(run: quadctl.Run):
    with pytest.raises(KeyError, match="there is no vehicle uav7") as raised:
        run.vehicles["uav7"]
    assert isinstance(raised.value, quadctl.Error)
    assert raised.value.hint == "there are uav"


def test_numbers_of_numpy_and_fractions_are_numbers(run: quadctl.Run):
    quad = run.vehicle
    goal: tuple[Any, ...] = (np.array(0.25), Fraction(1, 4), np.float32(1))
    patience: Any = np.float16(30)
    quad.goto(*goal, timeout=patience, replace=True)
    quad.params["safety.takeoff"] = Fraction(5, 4)
    assert quad.params["safety.takeoff"] == 1.25
    quad.params.update({"safety.takeoff": np.float32(1.5), "safety.acceptance_range": np.int64(1)})
    assert (quad.params["safety.takeoff"], quad.params["safety.acceptance_range"]) == (1.5, 1.0)
    assert isinstance(next(quad.watch("pose", seconds=np.float64(30))).seq, int)


AFTER: dict[str, Use] = {
    "goto": lambda quad: quad.goto(1, 1, 1),
    "calibrate": lambda quad: quad.calibrate(),
    "cage": lambda quad: quad.cage(on=True),
    "hold": lambda quad: quad.hold(),
    "reset": lambda quad: quad.reset(),
    "pose": lambda quad: quad.pose(),
    "pressure": lambda quad: quad.pressure(),
    "state": lambda quad: quad.state(),
    "settle": lambda quad: quad.settle(),
    "watch": lambda quad: quad.watch("pose"),
    "read a parameter": lambda quad: quad.params["safety.takeoff"],
    "set a parameter": lambda quad: quad.params.update({"safety.takeoff": 1.0}),
    "list parameters": lambda quad: list(quad.params),
}


@pytest.fixture(scope="module")
def closed() -> tuple[quadctl.Vehicle, quadctl.Watch[Any], quadctl.Flight, Any]:
    """Return a vehicle of a run that has ended, and what was begun with it."""
    run = quadctl.launch(params=FAST)
    quad = run.vehicle
    quad.settle()
    watch = quad.watch("pose")
    publisher = quad.client.raw_publisher("uav/own/word")
    flight = quad.goto(4, 4, 1.5, wait=False)
    run.close()
    run.close()
    with pytest.raises(quadctl.Error, match="ended"):
        run.logs()
    assert repr(run).endswith(", ended>")
    assert "closed" in repr(quad)
    return quad, watch, flight, publisher


@pytest.mark.parametrize("use", AFTER)
def test_use_after_the_end_says_that_it_is_over(closed: Any, use: str):
    with pytest.raises(quadctl.Unreachable, match="is closed") as raised:
        AFTER[use](closed[0])
    assert "quadctl.connect()" in raised.value.hint


def test_what_was_begun_before_the_end_says_that_it_is_over(closed: Any):
    _, watch, flight, publisher = closed
    for use in (lambda: [*watch], lambda: publisher.put(b"word"), flight.settle):
        with pytest.raises(quadctl.Unreachable, match="is closed"):
            use()
    if not flight.arrived:
        with pytest.raises(quadctl.Unreachable, match="is closed"):
            flight.wait()


@pytest.mark.parametrize("seconds", [float("inf"), 1e18, 10**400, Fraction(60)], ids=str)
def test_a_time_may_be_as_long_as_it_likes(run: quadctl.Run, seconds: Any):
    with quadctl.connect(run.realm, timeout=seconds) as quad:
        assert quad.pose().boot == quad.state().boot
        quad.goto(0, 0, 1.1, timeout=seconds, replace=True)


def test_a_connection_may_be_closed_while_others_use_it(run: quadctl.Run):
    quad, seen = quadctl.connect(run.realm), list[BaseException]()

    def use() -> None:
        try:
            while True:
                quad.state()
        except BaseException as error:  # noqa: BLE001 - looked at below
            seen.append(error)

    threads = [threading.Thread(target=use) for _ in range(3)]
    for thread in threads:
        thread.start()
    quad.state()
    quad.close()
    for thread in threads:
        thread.join(DEADLINE)
    assert [type(error) for error in seen] == [quadctl.Unreachable] * 3


CHILD = """
import os, sys, quadctl
run = quadctl.launch(params={"dynamics.speed": 0})
quad, realm = run.vehicle, run.realm
watch = quad.watch("pose")
for use in (quad.pose, quad.hold, lambda: next(watch), lambda: quadctl.connect(realm)):
    child = os.fork()
    if child == 0:
        try:
            use()
        except quadctl.Unreachable as error:
            assert "forked" in error.message and "spawn" in error.hint
            repr(run), repr(quad)
            quad.client.close()
            run.close()
            sys.exit(7)
        sys.exit(1)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
print(quad.pose().seq >= 0)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_process_leaves_the_run_of_its_parent_alone():
    # Python 3.12 and later warn of what is tried here: to fork a process that has threads.
    command = [sys.executable, "-W", "ignore:This process:DeprecationWarning", "-c", CHILD]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=DEADLINE)
    assert (done.returncode, done.stdout, done.stderr) == (0, "7\n7\n7\n7\nTrue\n", "")


def ended_by(run: quadctl.Run, how: str) -> None:
    supervisor = read(Realm(run.realm)).pid
    if how == "down":
        stop_run(Realm(run.realm))
    else:
        os.kill(supervisor, signal.SIGKILL if how == "kill -9" else signal.SIGSTOP)
    if how == "kill -9":
        eventually(lambda: not alive(supervisor))


@pytest.mark.parametrize(
    "how",
    ["down", "kill -9", pytest.param("freeze", marks=pytest.mark.thorough)],
)
def test_a_run_that_ended_otherwise_is_closed_in_silence(how: str):
    run = quadctl.launch(params=FAST)
    processes = [read(Realm(run.realm)).pid, *(p.pid for p in read(Realm(run.realm)).nodes)]
    watch = run.vehicle.watch("pose")
    next(watch)
    ended_by(run, how)
    if how != "freeze":
        eventually(lambda: repr(run).endswith(", ended>"))
        with pytest.raises(quadctl.Unreachable):
            list(watch)
    with pytest.raises(ZeroDivisionError), run:
        1 / 0  # noqa: B018 - an error of the program's own
    eventually(lambda: not any(map(alive, processes)))
    assert not Realm(run.realm).folder.exists()
    assert repr(run).endswith(", ended>")


def test_no_recording_is_overwritten(tmp_path: Path):
    file = tmp_path / "flight.mcap"
    file.write_bytes(b"mine")
    with pytest.raises(quadctl.Invalid, match="already exists"):
        quadctl.launch(params=FAST, record=file)
    assert file.read_bytes() == b"mine"


def test_each_object_shows_what_it_is(run: quadctl.Run):
    quad = run.vehicle
    assert repr(run) == f"<run {run.realm} of uav, running>"
    assert (repr(POSE), repr(GOTO)) == ("<topic pose: Pose>", "<service goto: Goto>")
    assert repr(quad) == f"<vehicle: <connection to uav on the realm {run.realm}>>"
    with quadctl.connect(run.realm) as other:
        assert repr(other).startswith("<connection: ")
        assert repr(other.watch("pose")) == "<watch of pose of uav, 0 lost>"
        flight = other.goto(0, 0, 1.2, wait=False, replace=True)
        flight.wait()
        assert repr(flight) == "<flight to (0, 0, 1.2), arrived>"
        assert other.client.latest(STATE).cage_on
    assert repr(other).endswith(", closed>>")
