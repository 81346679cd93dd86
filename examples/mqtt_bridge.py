"""The vehicle over MQTT: a bridge of your own, by the package's public names alone.

    python mqtt_bridge.py --broker 127.0.0.1:1883

It publishes `quadctl/VEHICLE/pose`, `/state` and `/pressure` as JSON, the state retained, and takes

    quadctl/VEHICLE/goto           {"x": 1, "y": 2, "z": 1}, m: the newest one counts
    quadctl/VEHICLE/call/SERVICE   the request of a service, e.g. hold, toggle_cage {"cage_on": false}
    quadctl/VEHICLE/param/get      names, separated by blanks; nothing stands for all
    quadctl/VEHICLE/param/set      {"safety.acceptance_range": 0.25}

It answers on the same topic with `/reply`: the response, or {"error": .., "hint": ..}. Whoever the broker
lets in may fly: give it passwords and an access list, as every broker has them.
"""

import argparse
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec
from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

import quadctl
from quadctl import BridgedVehicle, Node, Params, RequestQueue
from quadctl.schemas.messages import SafetyState
from quadctl.schemas.services import GotoRequest
from quadctl.schemas.topics import POSE_SLOW, PRESSURE, SERVICES, STATE
from quadctl.schemas.typed import from_json

encode = msgspec.json.encode


class Broker:
    """Connection to the broker, which may come later, and the vehicles behind it."""

    def __init__(self, host: str, port: int) -> None:
        self.client = Client(CallbackAPIVersion.VERSION2)
        self.client.reconnect_delay_set(1, 2)
        self.client.max_queued_messages_set(100)  # a broker that is away gets no old poses
        self.client.on_connect = self._on_connect
        self.client.on_message = self._on_message
        self.vehicles: dict[str, MqttVehicle] = {}
        self._place = host, port

    def open(self) -> None:
        """Connect, now or as soon as the broker is there."""
        self.client.connect_async(*self._place)
        self.client.loop_start()

    def _on_connect(self, *_: Any) -> None:
        names = "goto", "call/+", "param/get", "param/set"
        self.client.subscribe([(f"quadctl/+/{name}", 1) for name in names])

    def _on_message(self, _client: Client, _data: Any, message: MQTTMessage) -> None:
        _, name, rest = message.topic.split("/", 2)
        # A retained request was for an earlier flight.
        if name in self.vehicles and not message.retain:
            self.vehicles[name].take(rest, message.payload)


class MqttVehicle(BridgedVehicle):
    """Vehicle whose requests come from the broker, and are done in their order."""

    def __init__(self, node: Node, broker: Broker) -> None:
        super().__init__(node)
        self._broker = broker
        self._requests = RequestQueue(
            lambda fault: node.log.error("a request failed", exc_info=fault)
        )
        node.listen(STATE, self._on_state)
        node.listen(POSE_SLOW, lambda pose: self._publish("pose", encode(pose)))
        node.listen(PRESSURE, lambda reading: self._publish("pressure", encode(reading)))

    def take(self, topic: str, payload: bytes) -> None:
        """Take a request, on the thread of the MQTT client."""
        noun, _, name = topic.partition("/")
        match noun, name:
            case "goto", _:
                job = partial(self._answer, topic, self._goto, payload)
                taken = self._requests.order(job, newest=topic)
            case "param", "get":
                taken = self._requests.read(partial(self._answer, topic, self._get, payload))
            case "param", _:
                taken = self._requests.order(partial(self._answer, topic, self._set, payload))
            case _:
                call = partial(self._call, name)
                taken = self._requests.order(partial(self._answer, topic, call, payload))
        if taken == "full":
            self._publish(f"{topic}/reply", encode({"error": "too many requests wait"}))

    def _on_state(self, state: SafetyState) -> None:
        self.see(state)
        self._publish("state", encode(state), retain=True)  # kept for a client that comes later

    def _goto(self, payload: bytes) -> dict[str, bool]:
        at = from_json(payload, GotoRequest)
        self.fly(GotoRequest(at.x, at.y, at.z, replace=True))
        return {"accepted": True}

    def _call(self, name: str, payload: bytes) -> Any:
        found = next((each for each in SERVICES if each.name == name), None)
        if found is None:
            raise quadctl.Invalid(f"there is no service {name}", "see `quadctl service list`")
        return self.call(found, from_json(payload or b"{}", found.request))

    def _get(self, payload: bytes) -> dict[str, Any]:
        names, values = payload.decode().split(), self.parameters.read()
        return {name: values.get(name) for name in names} if names else values

    def _set(self, payload: bytes) -> dict[str, str]:
        return {"set": self.parameters.set(from_json(payload, dict[str, Any])) or "now"}

    def _answer(self, topic: str, do: Callable[[bytes], Any], payload: bytes) -> None:
        try:
            reply = do(payload)
        except quadctl.Error as problem:
            reply = {"error": problem.message, "hint": problem.hint}
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as problem:
            reply = {"error": f"not a valid request: {problem}"}
        self._publish(f"{topic}/reply", encode(reply))

    def _publish(self, name: str, payload: bytes, *, retain: bool = False) -> None:
        self._broker.client.publish(f"quadctl/{self.name}/{name}", payload, retain=retain)


def main() -> None:
    """Parse the bridge's own option, then run its node."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--broker", default="127.0.0.1:1883")
    given, sys.argv[1:] = parser.parse_known_args()
    host, _, port = given.broker.rpartition(":")
    broker = Broker(host or given.broker, int(port))

    def run(node: Node, _params: Params) -> None:
        if node.is_first:
            broker.open()
        broker.vehicles[node.vehicle] = MqttVehicle(node, broker)
        node.spin()

    quadctl.start("own-mqtt", run, keeps_time=True)


if __name__ == "__main__":
    main()
