"""Bridges as their clients meet them: what a client of any bridge can do, once for each protocol."""

import json
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial
from math import nan
from queue import SimpleQueue
from random import Random
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
import zenoh
from pymavlink.dialects.v20 import common as mavlink
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from quadctl.services.runtime.bus.session import free_port
from quadctl.services.runtime.procfs import stats_of
from tests.support.foxglove import TOKEN, FoxgloveClient, ServiceFailed, serves
from tests.support.lab import Lab
from tests.support.mavlink import ORIGIN, GroundStation
from tests.support.ros import raw_client, router
from tests.support.running import DEADLINE, Foreground, eventually

Order = str | tuple[float, float, float]
"""A command, e.g. `hold`, or a goal (m, ENU) in the place of the present one."""
LIMIT = "safety.acceptance_range"
"""Parameter that is read and set."""


class Outcome(NamedTuple):
    """Result of an order, with the reason that the client is shown for a failure."""

    done: bool
    reason: str = ""


class Side(Protocol):
    """Bridge of a run, and one client of it."""

    name: ClassVar[str]
    process: Foreground
    _lab: Lab
    _address: Any
    _options: tuple[str, ...]

    def __init__(self, lab: Lab, address: Any, *options: str) -> None:
        self._lab, self._address, self._options = lab, address, options
        self.start()

    def start(self, *more: str) -> None:
        """Start the process, with more options."""
        words = (*self.network, *self._options, *more)
        self.process = self._lab.spawn(*self._lab.command("bridge", self.name, *words))

    def stop(self) -> None:
        """End the process by Ctrl-C; nothing in it may have failed."""
        self.process.send(signal.SIGINT)
        assert self.process.wait() in {0, 130}, self.process.log[-2000:]
        assert "Traceback" not in self.process.log, self.process.log[-2000:]

    @property
    def memory(self) -> int:
        """Return the memory of the process, bytes."""
        return stats_of(self.process.pid).rss or 0

    @property
    def network(self) -> tuple[str, ...]:
        """Return the options that name the network."""

    def connect(self, *, may_act: bool = True) -> AbstractContextManager[None]:
        """Connect the client for a block, as soon as the bridge serves."""

    def pose(self) -> tuple[float, ...]:
        """Return the place of the next pose that comes."""

    def await_state(self, state: dict[str, Any]) -> None:
        """Wait until the client is shown a state, which is given as on our bus."""

    def order(self, order: Order) -> Outcome:
        """Give an order, and wait for its outcome."""

    def send(self, order: Order) -> None:
        """Give an order, and wait for nothing."""

    def limit(self) -> float:
        """Return the parameter."""

    def set_limit(self, value: float) -> Outcome:
        """Set the parameter."""

    def send_garbage(self, noise: Random) -> None:
        """Send what no client of the protocol would."""

    def half_open(self, number: int) -> AbstractContextManager[None]:
        """Begin this many connections or requests beside the client, and end none in the block."""

    def deaf(self) -> AbstractContextManager[None]:
        """Connect a client beside it that wants all poses and states, and reads nothing in the block."""

    @contextmanager
    def guarded(self) -> Iterator[None]:
        """Let only some clients act in the block; a bridge that does so always need not do anything."""
        yield


_CALLS: dict[str, tuple[str, dict[str, bool], int, tuple[float, ...]]] = {
    "hold": ("hold", {}, 0, (mavlink.MAV_CMD_NAV_LOITER_UNLIM,)),
    "cage on": ("toggle_cage", {"cage_on": True}, 1, (mavlink.MAV_CMD_DO_FENCE_ENABLE, 1)),
    "cage off": ("toggle_cage", {"cage_on": False}, 0, (mavlink.MAV_CMD_DO_FENCE_ENABLE,)),
    "calibrate": (
        "calibrate_pressure", {"zero": True}, 0, (mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, 0, 0, 1),
    ),
}  # fmt: skip
"""Our service of each command with its request, the byte of its request in ROS, and a command of MAVLink."""


class FoxgloveSide(Side):
    name = "foxglove"
    _topics = "uav/pose", "uav/safety/state"

    @property
    def network(self) -> tuple[str, ...]:
        self._lab.environment["QUADCTL_FOXGLOVE_TOKEN"] = TOKEN
        return "--control", "--port", str(self._address)

    @contextmanager
    def connect(self, *, may_act: bool = True) -> Iterator[None]:
        eventually(partial(serves, self._address))
        with self._client(*self._topics, token=TOKEN if may_act else "") as self.client:
            self._publish = self.client.publish("/goto")
            yield

    @property
    def _client(self) -> Any:
        return partial(FoxgloveClient, self._address)

    def pose(self) -> tuple[float, ...]:
        place = self.client.message("uav/pose")["position"]
        return place["x"], place["y"], place["z"]

    def await_state(self, state: dict[str, Any]) -> None:
        wanted = {name: state[name] for name in ("state", "reason", "goal", "cage_on", "request")}
        # It may have come already: this client reads on a thread of its own.
        self.client.message(
            "uav/safety/state", lambda shown: wanted.items() <= shown.items(), past=True
        )

    def order(self, order: Order) -> Outcome:
        name, request = _CALLS[order][:2] if isinstance(order, str) else ("goto", _goal(order))
        try:
            answer = self.client.call(f"uav/{name}", **request)
        except ServiceFailed as failed:
            return Outcome(False, str(failed))
        return Outcome(answer.get("accepted", True), answer.get("reason", ""))

    def send(self, order: Order) -> None:
        if isinstance(order, str):
            self.client.request(f"uav/{_CALLS[order][0]}", json.dumps(_CALLS[order][1]).encode())
        else:
            self._publish(json.dumps(_goal(order)).encode())

    def limit(self) -> float:
        return float(self.client.parameters(f"uav.{LIMIT}")[f"uav.{LIMIT}"]["value"])

    def set_limit(self, value: float) -> Outcome:
        self.client.set_parameters(**{f"uav.{LIMIT}": value})
        told = [each["message"] for each in self.client.documents if each["op"] == "status"]
        return Outcome(not told, "".join(told))

    def send_garbage(self, noise: Random) -> None:
        junk = noise.randbytes(noise.randrange(120))
        noise.choice((
            lambda: self._publish(junk),
            lambda: self.client.request("uav/toggle_cage", junk + b"}"),
            lambda: self.client.send_bytes(junk),
            lambda: self.client.send("setParameters", parameters=[{"name": "a.b", "value": {}}]),
        ))()  # fmt: skip

    @contextmanager
    def half_open(self, number: int) -> Iterator[None]:
        with ExitStack() as stack:
            for _ in range(number):
                stack.enter_context(socket.create_connection(("127.0.0.1", self._address)))
            yield

    @contextmanager
    def deaf(self) -> Iterator[None]:
        with self._client(reading=False) as client:
            client.subscribe_unread(*(self.client.channels[each] for each in self._topics))
            yield
            client.read()


def _goal(place: tuple[float, ...]) -> dict[str, float]:
    return dict(zip("xyz", place, strict=True), replace=True)


class MavlinkSide(Side):
    """Bridge to one ground station, the address; with a key, packets that are not signed do not count."""

    name = "mavlink"

    @property
    def network(self) -> tuple[str, ...]:
        return "--to", f"udpout:127.0.0.1:{self._address.port}"

    @contextmanager
    def connect(self, *, may_act: bool = True) -> Iterator[None]:
        self._codec = self._address._codec if may_act else mavlink.MAVLink(None, 255, 190)
        yield

    def pose(self) -> tuple[float, ...]:
        found = self._address.wait("LOCAL_POSITION_NED")
        return found.y, found.x, -found.z

    def await_state(self, state: dict[str, Any]) -> None:
        armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        wanted = {"HOVERING": 4 << 16 | 3 << 24}[state["state"]], armed, mavlink.MAV_STATE_ACTIVE
        self._address.wait(
            "HEARTBEAT", lambda m: (m.custom_mode, m.base_mode & armed, m.system_status) == wanted
        )

    def order(self, order: Order) -> Outcome:
        since, message = len(self._address.messages), self._message(order)
        # A bridge that is full wants the command once more.
        later = {mavlink.MAV_RESULT_IN_PROGRESS, mavlink.MAV_RESULT_TEMPORARILY_REJECTED}
        answer = self._address.ask(
            message, "COMMAND_ACK", lambda m: m.command == message.command and m.result not in later
        )
        done = answer.result == mavlink.MAV_RESULT_ACCEPTED
        return Outcome(done, " ".join(self._address.texts(since=since)))

    def send(self, order: Order) -> None:
        self._address.send_raw(self._message(order).pack(self._codec))

    def _message(self, order: Order) -> Any:
        if isinstance(order, str):
            number, *params = (*_CALLS[order][3], *(0.0,) * 7)[:8]
            return mavlink.MAVLink_command_long_message(1, 1, number, 0, *params)
        x, y = ORIGIN.to_earth(*order[:2])
        return mavlink.MAVLink_command_int_message(
            1, 1, mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_DO_REPOSITION, 0, 0,
            -1, 1, 0, nan, x, y, ORIGIN.altitude + order[2],
        )  # fmt: skip

    def limit(self) -> float:
        asked = mavlink.MAVLink_param_request_read_message(1, 1, b"S_ACCEPTANCE_RAN", -1)
        return float(self._address.ask(asked, "PARAM_VALUE").param_value)

    def set_limit(self, value: float) -> Outcome:
        since, real = len(self._address.messages), mavlink.MAV_PARAM_TYPE_REAL32
        set_ = mavlink.MAVLink_param_set_message(1, 1, b"S_ACCEPTANCE_RAN", value, real)
        found = self._address.ask(set_, "PARAM_VALUE").param_value
        return Outcome(found == value, " ".join(self._address.texts(since=since)))

    def send_garbage(self, noise: Random) -> None:
        whole = bytearray(self._message((1.0, 1.0, 1.0)).pack(self._codec))
        cut, place = whole[: noise.randrange(len(whole))], noise.randrange(len(whole))
        whole[place] ^= 1 << noise.randrange(8)
        junk = noise.randbytes(noise.randrange(300))
        self._address.send_raw(bytes(noise.choice((whole, cut, junk))))

    @contextmanager
    def half_open(self, number: int) -> Iterator[None]:
        """Send the halves of packets from the station, and whole ones from elsewhere."""
        self.pose()
        whole = self._message((1.0, 1.0, 1.0)).pack(mavlink.MAVLink(None, 255, 190))
        with ExitStack() as stack:
            for each in range(number):
                other = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                other.sendto(whole, self._address._to)
                self._address.send_raw(whole[: 1 + each % (len(whole) - 1)])
            yield

    @contextmanager
    def guarded(self) -> Iterator[None]:
        key, plain = bytes(range(200, 232)), self._address
        (self._lab.folder / "signing.key").write_bytes(key)
        self.stop()
        with GroundStation(key=key) as self._address:
            self.start("--signing-key", "signing.key")
            yield
            self.stop()
        self._address = plain
        self.start()
        self.pose()


_POSE, _STRING = "geometry_msgs/msg/PoseStamped", "std_msgs/msg/String"
_STORE, _HEAD = get_typestore(Stores.ROS2_JAZZY), b"\0\1\0\0"
_GOALS = f"0/uav/goal_pose/geometry_msgs::msg::dds_::PoseStamped_/{_STORE.hash_rihs01(_POSE)}"
for _name, _text in {
    "outcome": "bool success\nstring message",
    "names": "string[] names",
    "values": "rcl_interfaces/ParameterValue[] values",
    "parameters": "rcl_interfaces/Parameter[] parameters",
    "results": "rcl_interfaces/SetParametersResult[] results",
}.items():
    _STORE.register(get_types_from_msg(_text, f"test/msg/{_name}"))


def _encoded(type_: str, *fields: Any) -> bytes:
    return bytes(_STORE.serialize_cdr(_STORE.types[type_](*fields), type_))


def _attachment() -> bytes:
    """Return what rmw_zenoh wants of a sender: a number, a time, and its id."""
    return struct.pack("<qqB16s", 1, time.time_ns(), 16, bytes(16))


def _query(session: zenoh.Session, handler: Any, service: str, payload: bytes) -> None:
    """Call a service of the vehicle."""
    session.get(
        f"0/uav/{service}/**", handler, payload=payload, attachment=_attachment(), timeout=DEADLINE
    )


class RosSide(Side):
    """Bridge to a router, the address, whose clients all may act; the client is on plain Zenoh."""

    name = "ros2"

    @property
    def network(self) -> tuple[str, ...]:
        return "--router", self._address, "--domain", "0"

    @contextmanager
    def connect(self, *, may_act: bool = True) -> Iterator[None]:
        self._came = {name: SimpleQueue[zenoh.Sample]() for name in ("pose", "safety_state")}
        with raw_client(self._address) as self._session:
            subscribe = self._session.declare_subscriber
            _kept = [subscribe(f"0/uav/{name}/**", came.put) for name, came in self._came.items()]
            yield

    def pose(self) -> tuple[float, ...]:
        self._forget("pose")
        place = self._next("pose", _POSE).pose.position
        return place.x, place.y, place.z

    def await_state(self, state: dict[str, Any]) -> None:
        wanted = ": ".join(filter(None, (state["state"], state["reason"])))
        while self._next("safety_state", _STRING).data != wanted:
            pass

    def _forget(self, topic: str) -> None:
        while not self._came[topic].empty():
            self._came[topic].get()

    def _next(self, topic: str, type_: str) -> Any:
        sample = self._came[topic].get(timeout=DEADLINE)
        return _STORE.deserialize_cdr(sample.payload.to_bytes(), type_)

    def order(self, order: Order) -> Outcome:
        if isinstance(order, str):
            answer = self._ask(_CALLS[order][0], _HEAD + bytes([_CALLS[order][2]]), "outcome")
            return Outcome(answer.success, answer.message)
        self._forget("safety_state")
        self.send(order)
        while not self._next("safety_state", _STRING).data.startswith("VERIFYING"):
            pass
        state, _, reason = self._next("safety_state", _STRING).data.partition(": ")
        return Outcome(state == "MOVING" and not reason, reason)

    def send(self, order: Order) -> None:
        if isinstance(order, str):
            _query(self._session, id, _CALLS[order][0], _HEAD + bytes([_CALLS[order][2]]))
            return
        types = _STORE.types
        header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), "map")
        level = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        point = types["geometry_msgs/msg/Point"](*order)
        self._put(_encoded(_POSE, header, types["geometry_msgs/msg/Pose"](point, level)))

    def _put(self, goal: bytes) -> None:
        wait = zenoh.CongestionControl.BLOCK
        self._session.put(_GOALS, goal, attachment=_attachment(), congestion_control=wait)

    def _ask(self, service: str, request: bytes, response: str) -> Any:
        """Return the response of a service, or its refusal as an outcome."""
        answers = SimpleQueue[zenoh.Reply]()
        _query(self._session, answers.put, service, request)
        answer = answers.get(timeout=DEADLINE)
        if answer.err is not None:
            return _STORE.types["test/msg/outcome"](False, answer.err.payload.to_string())
        assert answer.ok is not None
        return _STORE.deserialize_cdr(answer.ok.payload.to_bytes(), f"test/msg/{response}")

    def limit(self) -> float:
        names = _encoded("test/msg/names", [LIMIT])
        (value,) = self._ask("quadctl/get_parameters", names, "values").values
        return float(value.double_value)

    def set_limit(self, value: float) -> Outcome:
        types, none = _STORE.types, partial(np.zeros, 0)
        given = types["rcl_interfaces/msg/ParameterValue"](
            3, False, 0, value, "", none("u1"), none("?"), none("i8"), none("f8"), []
        )
        given = types["rcl_interfaces/msg/Parameter"](LIMIT, given)
        parameters = _encoded("test/msg/parameters", [given])
        (found,) = self._ask("quadctl/set_parameters", parameters, "results").results
        return Outcome(found.successful, found.reason)

    def send_garbage(self, noise: Random) -> None:
        junk = noise.randbytes(noise.randrange(120))
        if noise.randrange(10):
            self._put(_HEAD + junk)
            return
        attachment = noise.choice((None, junk, _attachment()))
        self._session.get("0/uav/toggle_cage/**", id, payload=junk, attachment=attachment)

    def half_open(self, number: int) -> AbstractContextManager[None]:
        """Call services without reading their responses."""
        return _unread(self._address, str(number))

    def deaf(self) -> AbstractContextManager[None]:
        return _unread(self._address, "0")


_UNREAD = """
import json, struct, sys, threading, time, zenoh
wait = zenoh.handlers.Callback(lambda _: threading.Event().wait(), indirect=False)
config = {"mode": "client", "connect": {"endpoints": [sys.argv[1]]}, "timestamping": {"enabled": True}}
config["scouting"] = {"multicast": {"enabled": False}}
session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
sender = struct.pack("<qqB16s", 1, time.time_ns(), 16, bytes(16))
for each in range(int(sys.argv[2])):
    service, size = ("hold", 1) if each % 2 else ("quadctl/list_parameters", 16)
    request = bytes([0, 1, 0, 0]) + bytes(size)
    session.get(f"0/uav/{service}/**", wait, payload=request, attachment=sender, timeout=120)
subscriber = None if int(sys.argv[2]) else session.declare_subscriber("0/uav/**", wait)
print("up", flush=True)
threading.Event().wait()
"""


@contextmanager
def _unread(endpoint: str, calls: str) -> Iterator[None]:
    """Run a client that holds its connection up: a process, as sessions of one share their threads."""
    command = [sys.executable, "-c", _UNREAD, endpoint, calls]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline()
            yield
        finally:
            process.kill()


NAMES = ("foxglove", "mavlink", "ros2")


@contextmanager
def sides(lab: Lab, *options: str) -> Iterator[Callable[[str], Side]]:
    """Yield a function that returns the side of a bridge by its name, with the bridge started."""
    found: dict[str, Side] = {}
    with GroundStation() as station, router() as endpoint:
        kinds: dict[str, tuple[Callable[..., Side], Any]] = {
            "foxglove": (FoxgloveSide, free_port()),
            "mavlink": (MavlinkSide, station),
            "ros2": (RosSide, endpoint),
        }

        def side_of(name: str) -> Side:
            if name not in found:
                kind, address = kinds[name]
                found[name] = kind(lab, address, *options)
            elif found[name].process.ended:
                found[name].start()
            return found[name]

        yield side_of
        for side in found.values():
            if not side.process.ended:
                side.stop()
