"""The example of a bridge of one's own, driven by mosquitto's programs."""

import json
import shutil
import signal
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from quadctl.services.runtime.bus.session import free_port
from tests.support.abilities import SEARCH
from tests.support.lab import Lab
from tests.support.running import Foreground, eventually

EXAMPLE = Path(__file__).parents[2] / "examples" / "mqtt_bridge.py"
MOST_LINES = 150

pytestmark = [pytest.mark.thorough, pytest.mark.needs("mosquitto")]


def tool(name: str) -> str:
    found = shutil.which(name, path=SEARCH)
    assert found
    return found


def listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@contextmanager
def running(lab: Lab, *command: str) -> Iterator[Foreground]:
    """Run a program until the end of the block."""
    process = lab.spawn(*command)
    try:
        yield process
    finally:
        process.end()


@contextmanager
def broker(lab: Lab, port: int) -> Iterator[None]:
    """Run a broker on a port of this machine."""
    file = lab.folder / "mosquitto.conf"
    file.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\nuser root\n")
    with running(lab, tool("mosquitto"), "-c", str(file)):
        eventually(lambda: listens(port))  # its clients give up at once
        yield


@contextmanager
def bridge(lab: Lab, port: int) -> Iterator[Foreground]:
    words = ("--broker", f"127.0.0.1:{port}", "--realm", lab.realm)
    with running(lab, sys.executable, str(EXAMPLE), *words) as process:
        yield process
        process.send(signal.SIGTERM)
        assert process.wait() == 0, process.log
    assert "Traceback" not in process.log, process.log


class Client:
    """Everything that the bridge publishes, and a way to publish for it."""

    def __init__(self, lab: Lab, port: int, read: Foreground) -> None:
        self._lab, self._port, self._read = lab, str(port), read

    def wait(self, topic: str, condition: Any = lambda _: True, since: int = 0) -> Any:
        """Return the first message on a topic after `since` lines that fulfils a condition."""

        def found() -> Any:
            for line in self._read.log.splitlines()[since:]:
                name, _, text = line.partition(" ")
                if name == f"quadctl/uav/{topic}" and text.endswith("}"):
                    message = json.loads(text)
                    if condition(message):
                        return message
            return None

        return eventually(found)

    def is_answered(self, topic: str, payload: str) -> bool:
        """Publish a request, and return whether a reply has come to it or to an earlier one."""
        self.publish(topic, "-m", payload)
        return f"quadctl/uav/{topic}/reply " in self._read.log

    def ask(self, topic: str, payload: str) -> Any:
        """Publish a request, and return the reply."""
        since = len(self._read.log.splitlines())
        self.publish(topic, "-m", payload)
        return self.wait(f"{topic}/reply", since=since)

    def publish(self, topic: str, *words: str, lines: str = "") -> None:
        command = [tool("mosquitto_pub"), "-p", self._port, "-t", f"quadctl/uav/{topic}", *words]
        if lines:
            file = self._lab.folder / "lines.txt"
            file.write_text(lines)
            command = ["sh", "-c", f"{' '.join(command)} < {file}"]
        assert self._lab.spawn(*command).wait() == 0


@pytest.fixture
def port() -> int:
    return free_port()


@contextmanager
def joined(lab: Lab, port: int) -> Iterator[Client]:
    """Run a broker and a client of it, from when the bridge has joined it."""
    everything = (tool("mosquitto_sub"), "-p", str(port), "-v", "-t", "quadctl/uav/#")
    with broker(lab, port), running(lab, *everything) as read:
        client = Client(lab, port, read)
        # The bridge may publish a moment before it subscribes: what it has not heard yet is lost.
        eventually(lambda: client.is_answered("param/get", "safety.takeoff"))
        yield client


@pytest.fixture
def client(lab: Lab, port: int) -> Iterator[Client]:
    lab.start("--set", "dynamics.start.z=1")
    with bridge(lab, port), joined(lab, port) as made:
        yield made


def test_the_example_is_short_and_uses_public_names_alone():
    text = EXAMPLE.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= MOST_LINES
    assert "services" not in text.replace("SERVICES", "").replace("schemas.services", "")


def test_the_vehicle_is_read_flown_and_refused_over_mqtt(client: Client):
    assert client.wait("state")["state"] == "HOVERING"
    assert client.wait("pressure")["pressure"] > 900
    assert client.ask("goto", '{"x": 1, "y": 0.5, "z": 1}') == {"accepted": True}
    client.wait("pose", lambda pose: abs(pose["position"]["x"] - 1) < 0.1)
    assert "outside the cage" in client.ask("goto", '{"x": 9, "y": 0, "z": 1}')["error"]
    assert client.ask("call/toggle_cage", '{"cage_on": false}') == {"success": True}
    assert "there is no service fly" in client.ask("call/fly", "{}")["error"]
    assert "not a valid request" in client.ask("goto", "north")["error"]
    name = "safety.acceptance_range"
    assert client.ask("param/set", f'{{"{name}": 0.375}}') == {"set": "now"}
    assert client.ask("param/get", name) == {name: 0.375}
    assert "expected" in client.ask("param/set", f'{{"{name}": -1}}')["error"]


def test_of_a_flood_of_goals_the_newest_counts_and_calls_have_room(client: Client, lab: Lab):
    goals = "".join(f'{{"x": {n % 3}, "y": 0, "z": 1}}\n' for n in range(5000))
    client.publish("goto", "-l", lines=goals + '{"x": 2, "y": 2, "z": 1}\n')
    assert client.ask("call/hold", "{}") == {"success": True}
    state = lab.quadctl("state", "--json").json
    assert state["request"] < 500  # 20 goals a second, and not 5000
    assert client.ask("goto", '{"x": -1, "y": 0, "z": 1}') == {"accepted": True}


def test_it_serves_again_after_the_loss_of_the_hub(client: Client, lab: Lab):
    since = client.wait("pose")["seq"]
    lab.revived("hub", lab.signal("hub", signal.SIGKILL))
    client.wait("pose", lambda pose: pose["seq"] > since)
    assert client.ask("call/hold", "{}") == {"success": True}


def test_a_bridge_joins_a_broker_that_comes_later_or_again(lab: Lab, port: int):
    lab.start("--set", "dynamics.start.z=1")
    with bridge(lab, port):
        for _ in range(2):
            with joined(lab, port) as client:
                assert client.ask("call/hold", "{}") == {"success": True}
