"""Independent client on the bus: Zenoh and MessagePack, no import of schemas, services or cli."""

import json
import threading
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import Any, NamedTuple, Self

import msgspec
import zenoh

from tests.support.running import DEADLINE

pack = msgspec.msgpack.encode
unpack = msgspec.msgpack.decode


class Answer(NamedTuple):
    """Reply or error reply, with its contents and encoding."""

    ok: bool
    value: Any
    encoding: str

    @property
    def code(self) -> str:
        """Return the error's code, or an empty text for a reply."""
        return "" if self.ok else str(self.value["code"])


class Watch:
    """Decoded messages of a key, in their order of arrival."""

    def __init__(self) -> None:
        self.messages: list[Any] = []
        self.encodings: list[str] = []
        self.times: list[float] = []
        """Arrival of each message, monotonic s."""
        self._read = 0
        self._changed = threading.Condition()

    def on_sample(self, sample: zenoh.Sample) -> None:
        value, now = unpack(sample.payload.to_bytes()), time.monotonic()
        with self._changed:
            self.times.append(now)
            self.encodings.append(str(sample.encoding))
            self.messages.append(value)
            self._changed.notify_all()

    def until(self, condition: Callable[[Any], bool], within: float = DEADLINE) -> Any:
        """Return the first message, after the last one returned, that meets the condition.

        It may have arrived before this call: an action's effect can arrive before its reply.
        """
        deadline = time.monotonic() + within
        with self._changed:
            while True:
                while self._read < len(self.messages):
                    self._read += 1
                    if condition(message := self.messages[self._read - 1]):
                        return message
                left = deadline - time.monotonic()
                last = self.messages[-1:] or "nothing"
                assert left > 0, f"not in {within:g} s; the last was {last}"
                self._changed.wait(left)

    def next(self, count: int = 1, within: float = DEADLINE) -> list[Any]:
        """Wait for `count` messages from now on, and return them."""
        with self._changed:
            first = len(self.messages)
            enough = self._changed.wait_for(lambda: len(self.messages) >= first + count, within)
            assert enough, f"{len(self.messages) - first} of {count} came in {within:g} s"
            self._read = first + count
            return self.messages[first : first + count]


class Bare:
    """Client session with a hub."""

    def __init__(self, endpoint: str, user: str = "", password: str = "") -> None:
        config: dict[str, Any] = {
            "mode": "client",
            "connect": {"endpoints": [endpoint], "retry": {"period_init_ms": 10}},
            "scouting": {"multicast": {"enabled": False}},
        }
        if user:
            auth = {"usrpwd": {"user": user, "password": password}}
            config["transport"] = {"auth": auth}
        self.session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        self._declared: list[Any] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.session.close()

    def call(self, service: str, timeout: float = DEADLINE, **fields: Any) -> Answer:
        """Call a service with a map of fields, and return its only reply."""
        return self.query(f"uav/@srv/{service}", pack(fields), timeout=timeout)

    def query(self, key: str, payload: bytes, timeout: float = DEADLINE, **more: Any) -> Answer:
        """Query a key with any bytes, and return the only reply."""
        answers = self.answers(key, payload, timeout=timeout, **more)
        assert len(answers) == 1, f"{key}: {len(answers)} replies"
        return answers[0]

    def answers(
        self, key: str, payload: bytes, timeout: float = DEADLINE, **more: Any
    ) -> list[Answer]:
        """Return all replies to a query."""
        return list(self.send(key, payload, timeout=timeout, **more))

    def send(self, key: str, payload: bytes, timeout: float, **more: Any) -> Iterator[Answer]:
        """Send a query now; the iterator waits for its replies."""
        replies = self.session.get(key, payload=payload, timeout=timeout, **more)
        return (_answer(reply) for reply in replies)

    def latest(self, key: str) -> Any:
        """Return the last message of a latched topic."""
        return self.query(key, b"").value

    def watch(self, key: str) -> Watch:
        """Subscribe to a key until the session closes."""
        watch = Watch()
        self._declared.append(self.session.declare_subscriber(key, watch.on_sample))
        return watch

    def watch_calls(self, name: str) -> Watch:
        """Subscribe to executed calls of safety's services, e.g. `goto`, and see that safety knows it.

        A publisher drops what nobody subscribes to, and the subscription needs a moment to get there.
        """
        watch = self.watch(f"uav/@call/{name}")
        self.state()  # goes the same way, after it
        return watch

    def put(self, key: str, value: Any) -> None:
        """Publish a map without a type in its encoding."""
        self.session.put(key, pack(value))

    def nodes(self) -> list[str]:
        """Return the names of the announced nodes."""
        replies = self.session.liveliness().get("uav/@node/*", timeout=DEADLINE)
        keys = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
        return sorted(key.rpartition("/")[2] for key in keys)

    def state(self) -> dict[str, Any]:
        """Return the current state of safety."""
        state: dict[str, Any] = self.latest("uav/safety/state")
        return state

    def restart(self, vehicles: Iterable[str]) -> None:
        """Turn the cage on and the baseline off, and put each vehicle on its start; wait until all hover."""
        boots, watches = set[str](), list[Watch]()
        for vehicle in vehicles:
            assert self.query(f"{vehicle}/@srv/toggle_cage", pack({"cage_on": True})).ok
            assert self.query(f"{vehicle}/@srv/calibrate_pressure", pack({"zero": False})).ok
            boots.add(self.latest(f"{vehicle}/safety/state")["boot"])
            watches.append(self.watch(f"{vehicle}/safety/state"))
            assert self.query(f"{vehicle}/@srv/reset", pack({})).ok
        for states in watches:
            states.until(
                lambda s: s["boot"] not in boots and s["state"] == "HOVERING" and s["goal"]["z"] > 0
            )

    def fly(self, x: float, y: float, z: float) -> dict[str, Any]:
        """Fly to a point, replacing any goal, and return the state on arrival."""
        states, poses = self.watch("uav/safety/state"), self.watch("uav/pose")
        goal = {"x": x, "y": y, "z": z}
        assert self.call("goto", **goal, replace=True).value == {"accepted": True, "reason": ""}
        arrived: dict[str, Any] = states.until(
            lambda s: s["goal"] == goal and s["state"] == "HOVERING"
        )
        poses.until(lambda pose: gap(pose["position"], goal) < 0.05 and speed(pose) < 0.05)
        return arrived


def ticket(seconds: float, call_id: str = "", **more: Any) -> bytes:
    """Return a call's attachment: an id, a deadline some seconds from now, and further fields."""
    return pack({"id": call_id or uuid.uuid4().hex, "deadline": time.time() + seconds, **more})


def gap(a: dict[str, float], b: dict[str, float]) -> float:
    """Return the distance between two points, m."""
    return float(sum((a[axis] - b[axis]) ** 2 for axis in "xyz") ** 0.5)


def speed(pose: dict[str, Any]) -> float:
    """Return the vehicle's speed, m/s."""
    return gap(pose["velocity"], {"x": 0.0, "y": 0.0, "z": 0.0})


def _answer(reply: zenoh.Reply) -> Answer:
    if reply.ok is not None:
        sample = reply.ok
        return Answer(True, unpack(sample.payload.to_bytes()), str(sample.encoding))
    assert reply.err is not None
    payload, encoding = reply.err.payload.to_bytes(), str(reply.err.encoding)
    is_json = encoding.startswith("application/json")
    return Answer(False, json.loads(payload) if is_json else payload, encoding)
