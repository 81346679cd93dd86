"""Network of ROS 2 without ROS: a router, and an independent client of rmw_zenoh."""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import zenoh
from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import (
    ROS2Publisher,
    ROS2ServiceClient,
    ROS2Subscriber,
    get_registry,
    message_registry,
)
from zenoh_ros2_sdk.session import ZenohSession

from quadctl.services.bridges.ros2 import graph, messages
from quadctl.services.bridges.ros2.messages import RosService
from quadctl.services.runtime.bus.session import free_port
from tests.support import bridges
from tests.support.lab import Lab
from tests.support.running import DEADLINE, Foreground

_STORE = get_typestore(Stores.ROS2_JAZZY)
POSE = "geometry_msgs/msg/PoseStamped"
TYPES = {
    "pose": POSE,
    "odom": "nav_msgs/msg/Odometry",
    "pressure": "sensor_msgs/msg/FluidPressure",
    "cage": "visualization_msgs/msg/MarkerArray",
    "safety_state": "std_msgs/msg/String",
}
_OUTCOME = "bool success\nstring message"
_ROUTER = """
import sys, time, zenoh
with zenoh.open(zenoh.Config.from_json5(sys.argv[1])):
    print("up", flush=True)
    sys.stdin.read()
"""


@contextmanager
def router(port: int = 0) -> Iterator[str]:
    """Start a router as rmw_zenohd does, and yield its endpoint."""
    endpoint = f"tcp/127.0.0.1:{port or free_port()}"
    config = {
        "mode": "router",
        "listen": {"endpoints": [endpoint]},
        "scouting": {"delay": 0, "multicast": {"enabled": False}},
    }
    command = [sys.executable, "-c", _ROUTER, json.dumps(config)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline()
        try:
            yield endpoint
        finally:
            process.stdin.close()
            process.wait(DEADLINE)


@contextmanager
def bridged(lab: Lab, endpoint: str, domain: str, *options: str) -> Iterator[Foreground]:
    """Bridge the run of a lab to a router, see bridges.bridged."""
    words = ("--router", endpoint, "--domain", domain, *options)
    with bridges.bridged(lab, "ros2", *words) as process:
        yield process


@contextmanager
def readers(session: zenoh.Session, domain: str) -> Iterator[None]:
    """Subscribe to all topics of a vehicle, and wait until poses come."""
    came = threading.Event()
    subscribers = [
        session.declare_subscriber(key, lambda _sample: came.set())
        for key in (f"{domain}/uav/**", f"{domain}/tf/**")
    ]
    assert came.wait(DEADLINE)
    yield
    for subscriber in subscribers:
        subscriber.undeclare()


def call(session: zenoh.Session, name: str, service: RosService, *fields: Any) -> Any:
    """Call a service of ROS by its key without the hash, e.g. `0/uav/hold`, with its request's fields."""
    domain, _, rest = name.partition("/")
    key = graph.endpoint_key(int(domain), f"/{rest}", graph.type_key(service.name, service.hash))
    sender = graph.attachment(1, time.time_ns(), bytes(16))
    payload = messages.encode(messages.message(service.request, *fields))
    (reply,) = session.get(key, payload=payload, attachment=sender, timeout=DEADLINE)
    assert reply.ok is not None, reply.err
    return messages.decode(service.response, reply.ok.payload.to_bytes())


def bridge(
    realm: str, endpoint: str, *more: str
) -> AbstractContextManager[subprocess.Popen[bytes]]:
    """Bridge a run to a router, see bridges.bridge."""
    return bridges.bridge(realm, "ros2", "--router", endpoint, *more)


def raw_client(endpoint: str) -> zenoh.Session:
    """Return a plain client of the router."""
    config = {
        "mode": "client",
        "connect": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}},
        "timestamping": {"enabled": True},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


class RosClient:
    """Program of ROS with the SDK's publishers, subscribers and clients of one vehicle."""

    def __init__(self, endpoint: str, folder: Path, vehicle: str = "uav") -> None:
        for type_ in TYPES.values():
            _write_definitions(folder, type_)
        get_registry(str(folder))
        self._port, self._vehicle = int(endpoint.rpartition(":")[2]), vehicle
        self.came: dict[str, list[Any]] = {name: [] for name in TYPES}
        self._subscribers = [
            ROS2Subscriber(f"/{vehicle}/{name}", type_, self.came[name].append, **self._router)
            for name, type_ in TYPES.items()
        ]
        self._goals = ROS2Publisher(f"/{vehicle}/goal_pose", POSE, **self._router)

    def close(self) -> None:
        """Close the SDK's one session of a process, and forget which types it knew.

        Two modules of tests may run in one process, and each has a client.
        """
        instance, ZenohSession._instance = ZenohSession._instance, None
        message_registry._registry = None
        instance.session.close()

    def wait(
        self, name: str, condition: Callable[[Any], bool] = lambda _: True, timeout: float = 20.0
    ) -> Any:
        """Return the next message of a topic that fulfils a condition."""
        start, deadline = len(self.came[name]), time.monotonic() + timeout
        while time.monotonic() < deadline:
            for message in self.came[name][start:]:
                start += 1
                if condition(message):
                    return message
            time.sleep(0.01)
        raise AssertionError(f"nothing came on {name}: {self.came[name][-3:]}")

    def goal(self, x: float, y: float, z: float, frame: str = "map") -> None:
        """Publish a goal, as RViz's tool does."""
        types = ZenohSession._instance.store.types
        stamp = types["builtin_interfaces/msg/Time"](0, 0)
        self._goals.publish(
            header=types["std_msgs/msg/Header"](stamp, frame),
            pose=types["geometry_msgs/msg/Pose"](
                types["geometry_msgs/msg/Point"](x, y, z),
                types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
            ),
        )

    def call(self, name: str, type_: str, definition: str = "# none", **request: Any) -> Any:
        """Call a service of the vehicle."""
        client = ROS2ServiceClient(
            f"/{self._vehicle}/{name}",
            type_,
            request_definition=definition,
            response_definition=_OUTCOME,
            **self._router,
        )
        return client.call(**request)

    @property
    def _router(self) -> dict[str, Any]:
        return {"router_ip": "127.0.0.1", "router_port": self._port}


def _write_definitions(folder: Path, type_: str) -> None:
    """Write a type and those within it as .msg files: the SDK would load them from the internet."""
    own, *others = _STORE.generate_msgdef(type_, ros_version=2)[0].split("=" * 80)
    texts = {type_: own}
    for other in others:
        head, _, text = other.lstrip("\n").partition("\n")
        package, _, name = head.removeprefix("MSG: ").rpartition("/")
        texts[f"{package.removesuffix('/msg')}/msg/{name}"] = text
    for name, text in texts.items():
        path = folder / f"{name}.msg"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
