"""The vehicle in Foxglove, seen and flown by a client of its protocol."""

import asyncio
import json
import os
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from math import dist
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zenoh
from msgspec import structs
from websockets.asyncio.client import connect as secure
from websockets.exceptions import InvalidMessage, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

import quadctl
from quadctl.cli.bridge.foxglove import LAYOUT
from quadctl.schemas.messages import Position, SafetyState
from quadctl.schemas.topics import SERVICES, TOPICS
from quadctl.schemas.typeinfo import json_schema
from quadctl.services.runtime.bus import codec, session
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.bus.session import free_port
from quadctl.services.runtime.realm import Realm
from tests.support import bridges
from tests.support.foxglove import (
    OLD_SUBPROTOCOL,
    SUBPROTOCOL,
    TOKEN,
    FoxgloveClient,
    ServiceFailed,
    bridge,
    request,
    response,
    serves,
)
from tests.support.lab import Lab
from tests.support.running import eventually


@pytest.fixture(scope="module")
def run() -> Iterator[quadctl.Run]:
    with quadctl.launch() as run:
        # A hold of any test, also of the first one, is then at a height that every test can use.
        eventually(lambda: run.vehicle.pose().position.z > 0.95)
        yield run


@pytest.fixture(scope="module")
def port(run: quadctl.Run) -> Iterator[int]:
    port = free_port()
    with bridge(run.realm, port, "--control"):
        yield port


@pytest.fixture
def client(port: int) -> Iterator[FoxgloveClient]:
    with FoxgloveClient(port, everything=True) as client:
        client.message("uav/pose")
        yield client


def advertises(topic: str, document: Any) -> bool:
    return any(each["topic"] == topic for each in document["channels"])


def at(pose: Any) -> tuple[float, float, float]:
    place = pose["position"]
    return place["x"], place["y"], place["z"]


@pytest.mark.thorough
def test_topics_services_and_their_schemas_are_those_of_a_recording(client: FoxgloveClient):
    for topic in TOPICS:
        channel = client.channels[topic.key("uav")]
        assert channel["encoding"] == "json"
        assert channel["schemaName"] == f"quadctl.{topic.type.__name__}"
        assert json.loads(channel["schema"]) == json_schema(topic.type)
    assert client.channels["/tf"]["schemaName"] == "foxglove.FrameTransform"
    assert client.channels["/scene"]["schemaName"] == "foxglove.SceneUpdate"
    for service in SERVICES:
        offered = client.services[f"uav/{service.name}"]
        assert json.loads(offered["request"]["schema"]) == json_schema(service.request)
        assert json.loads(offered["response"]["schema"]) == json_schema(service.response)


def test_frames_are_the_poses(client: FoxgloveClient, run: quadctl.Run):
    frame = client.message("/tf")
    assert (frame["parent_frame_id"], frame["child_frame_id"]) == ("map", "uav")
    assert abs(frame["timestamp"]["sec"] - time.time()) < 5


def with_data(client: FoxgloveClient, topic: str) -> list[dict[str, Any]]:
    """Return the messages of a topic that are not empty, also those that came before the call."""
    plain = (each.json for each in client.messages if each.topic == topic)
    return [each for each in plain if each["data"]]


def test_a_users_own_topic_and_the_calls_are_shown_too(client: FoxgloveClient, run: quadctl.Run):
    publish = [sys.executable, "-m", "quadctl", "topic", "pub", "own/note", "{text: hello}"]
    subprocess.run([*publish, "--realm", run.realm], check=True, timeout=30)
    client.wait(lambda: "uav/own/note" in client.channels)
    with session.open_client(session.address_of(Realm(run.realm))) as bus:
        for encoding, data in (
            ("zenoh/bytes", "c100"), ("application/msgpack", "c100"), ("text/plain", "hello"),
        ):  # fmt: skip
            key = f"uav/own/{encoding.partition('/')[2]}"
            payload = bytes.fromhex(data) if data == "c100" else data.encode()
            bus.put(key, b"", encoding=encoding)
            client.document("advertise", partial(advertises, key))
            client.parameters("none")  # answered after the subscription is made
            bus.put(key, payload, encoding=encoding)
            assert client.wait(partial(with_data, client, key)) == [{"data": data}]
    client.call("uav/hold")
    called = client.wait(lambda: "uav/@call/hold" in client.channels)
    assert called


def test_a_published_goal_is_flown_and_a_refusal_is_shown(client: FoxgloveClient, run: quadctl.Run):
    publish = client.publish("/goto")
    publish(b'{"x": 0, "y": 0, "z": 1.2}')
    client.message("uav/pose", lambda pose: dist(at(pose), (0, 0, 1.2)) < 0.05)
    client.message("uav/safety/state", lambda state: state["state"] == "HOVERING")
    publish(b'{"header": {}, "pose": {"position": {"x": 0.5, "y": 0, "z": 0}}}')
    client.message("uav/pose", lambda pose: dist(at(pose), (0.5, 0, 1.2)) < 0.05)
    publish(b'{"x": 9, "y": 0, "z": 1}')
    client.document("status", lambda each: "outside the cage: x = 9" in each["message"])


def test_a_topic_that_nobody_takes_is_named(client: FoxgloveClient):
    client.publish("/cmd_vel", 7)
    told = client.document("status", lambda each: "/cmd_vel" in each["message"])
    assert told["message"] == "nobody takes /cmd_vel: publish to one of /uav/goto, /goto"


def test_parameters_are_read_and_set_with_their_types(client: FoxgloveClient, run: quadctl.Run):
    everything = client.parameters()
    assert everything["uav.safety.takeoff"]["type"] == "float64"
    assert everything["uav.safety.cage_on"]["value"] is True
    assert isinstance(everything["uav.dynamics.seed"]["value"], int)
    assert "type" not in everything["uav.dynamics.seed"]
    assert everything["uav.safety.zones"]["value"] == []
    name = "uav.safety.acceptance_range"
    assert list(client.parameters(name)) == [name]
    client.send("subscribeParameterUpdates", parameterNames=[name])
    assert client.set_parameters(**{name: 0.375})[name]["value"] == 0.375
    assert run.vehicle.params["safety.acceptance_range"] == 0.375
    assert client.set_parameters(**{name: 1})[name] == {
        "name": name, "value": 1.0, "type": "float64",
    }  # fmt: skip
    assert client.set_parameters(**{name: -1.0})[name]["value"] == 1.0
    client.document("status", lambda each: "safety.acceptance_range" in each["message"])
    run.vehicle.params["safety.acceptance_range"] = 0.25
    client.document(
        "parameterValues", lambda each: [p["value"] for p in each["parameters"]] == [0.25]
    )


@pytest.mark.thorough
def test_a_users_own_node_has_its_parameters_there(client: FoxgloveClient, run: quadctl.Run):
    values, name = {"meter.scale": 2.5}, "uav.meter.scale"

    def get(query: zenoh.Query) -> None:
        with query:
            reply = msgspec.msgpack.encode({"values": values})
            query.reply(query.key_expr, reply, encoding="application/msgpack")

    def change(query: zenoh.Query) -> None:
        with query:
            assert query.payload is not None
            values.update(msgspec.msgpack.decode(query.payload.to_bytes())["values"])
            reply = msgspec.msgpack.encode({"success": True, "reason": ""})
            query.reply(query.key_expr, reply, encoding="application/msgpack")

    with Client(run.realm, "uav") as own:
        declared: list[Any] = []
        for service, type_, handler in (
            ("get_params", "GetParams", get),
            ("set_params", "SetParams", change),
        ):
            key = f"uav/@srv/meter/{service}"
            token = f"uav/@node/meter/@srv/{type_}/00000000/0/{key.replace('/', '%')}"
            declared += [
                own.session.declare_queryable(key, handler, complete=True),
                own.session.liveliness().declare_token(token),
            ]
        eventually(lambda: name in client.parameters())
        assert client.set_parameters(**{name: 3.5})[name]["value"] == 3.5
        assert values == {"meter.scale": 3.5}
        assert run.vehicle.params["meter.scale"] == 3.5


@pytest.mark.thorough
def test_without_control_nothing_can_be_changed():
    port = free_port()
    with quadctl.launch() as other, bridge(other.realm, port), FoxgloveClient(port) as client:
        before, name = other.vehicle.state(), "uav.safety.takeoff"
        with pytest.raises(ServiceFailed, match=r"this client may only watch: .*bridge foxglove"):
            client.call("uav/hold")
        assert client.set_parameters(**{name: 2.0})[name]["value"] == 1.0
        client.document("status", lambda each: each["id"] == "parameters")
        client.publish("/goto")(b'{"x": 1, "y": 0, "z": 1}')
        client.document("status", lambda each: each["id"] == "/goto")
        # What is published is handled before what is requested later.
        assert client.parameters(name)[name]["value"] == 1.0
        assert other.vehicle.state().request == before.request


def test_a_wrong_token_is_named(port: int):
    with FoxgloveClient(port, token="stale") as client:
        told = client.document("status")
        assert told["message"] == "the token in this address is not of this bridge"
        with pytest.raises(ServiceFailed, match="this client may only watch"):
            client.call("uav/hold")


def test_pages_of_foreign_sites_may_not_connect(port: int):
    for origin, status in (
        ("https://example.org", 403), ("null", 403), ("http://localhost:8080", 101),
    ):  # fmt: skip
        assert upgraded(port, origin) == status, origin


def upgraded(port: int, origin: str) -> int:
    """Return the HTTP status of a handshake from a page."""
    try:
        with connect(
            f"ws://127.0.0.1:{port}/?token={TOKEN}",
            subprotocols=[SUBPROTOCOL],
            origin=Origin(origin),
        ):
            return 101
    except InvalidStatus as refused:
        return refused.response.status_code


@pytest.mark.thorough
def test_an_older_viewer_names_the_protocol_differently(port: int):
    with FoxgloveClient(port, subprotocol=OLD_SUBPROTOCOL) as client:
        assert client.call("uav/hold") == {"success": True}


def test_a_late_subscriber_gets_state_and_scene_at_once(port: int, client: FoxgloveClient):
    client.message(
        "uav/safety/state"
    )  # the bridge has one: its first may come after the first pose
    with FoxgloveClient(port) as late:
        asked = time.time_ns()
        late.subscribe("uav/safety/state", "/scene")
        late.wait(lambda: {m.topic for m in late.messages} == {"uav/safety/state", "/scene"})
    # Not the next one, which may come a second later.
    assert next(m for m in late.messages if m.topic == "uav/safety/state").at < asked
    scene = next(m.json for m in late.messages if m.topic == "/scene")
    ids = {each["id"] for each in scene["entities"]}
    assert ids == {"uav/cage", "uav/goal", "uav/body"}


def test_the_connection_graph_names_the_nodes(client: FoxgloveClient):
    client.send("subscribeConnectionGraph")
    graph = client.document("connectionGraphUpdate", lambda each: each["publishedTopics"])
    publishers = {each["name"]: each["publisherIds"] for each in graph["publishedTopics"]}
    assert publishers["uav/pose"] == ["uav/dynamics"]
    providers = {each["name"]: each["providerIds"] for each in graph["advertisedServices"]}
    assert providers["uav/goto"] == ["uav/safety"]


@pytest.mark.thorough
def test_a_certificate_encrypts_it(lab: Lab):
    for words in ("init", "issue hub"):
        assert lab.quadctl("keys", *words.split()).code == 0
    lab.start()
    port, keys = free_port(), lab.folder / "keys" / "hub"
    options = ("--host", "0.0.0.0", "--cert", keys / "cert.pem", "--key", keys / "key.pem")
    trusting = ssl.create_default_context(cafile=keys / "ca.pem")
    trusting.check_hostname = False
    lab.environment["QUADCTL_FOXGLOVE_TOKEN"] = TOKEN
    with bridges.bridged(lab, "foxglove", "--control", "--port", str(port), *map(str, options)):
        assert asyncio.run(called_encrypted(port, "uav/hold", trusting)) == {"success": True}
        with pytest.raises((InvalidMessage, OSError)):
            FoxgloveClient(port)


async def called_encrypted(port: int, service: str, trusting: ssl.SSLContext) -> Any:
    """Call a service over TLS, without arguments; return its response.

    FoxgloveClient reads and writes in two threads, which fails at times on one TLS connection of
    Python: https://github.com/python/cpython/issues/143756.
    """
    address = f"wss://127.0.0.1:{port}/?token={TOKEN}"
    async with asyncio.timeout(20), secure(address, ssl=trusting, subprotocols=[SUBPROTOCOL]) as it:
        async for data in it:
            if isinstance(data, bytes):
                if answer := response(data):
                    return answer[1]
            elif (document := json.loads(data))["op"] == "advertiseServices":
                numbers = {each["name"]: each["id"] for each in document["services"]}
                if service in numbers:
                    await it.send(request(numbers[service], 1, b"{}"))
    raise AssertionError("the bridge closed the connection")


@pytest.mark.thorough
def test_several_vehicles_share_a_server_and_a_scene():
    port = free_port()
    with quadctl.launch(vehicles=2) as run, bridge(run.realm, port, "--control"):
        with FoxgloveClient(port, everything=True) as client:
            client.wait(lambda: "uav1/hold" in client.services)
            for name in ("uav0", "uav1"):
                client.message(f"{name}/pose")
                client.message("/tf", lambda frame, name=name: frame["child_frame_id"] == name)
                assert client.call(f"{name}/hold") == {"success": True}
            assert {"uav0.safety.takeoff", "uav1.safety.takeoff"} <= client.parameters().keys()
            client.publish("/uav1/goto")(b'{"x": 2, "y": 1, "z": 1}')
            client.message("uav1/pose", lambda pose: dist(at(pose), (2, 1, 1)) < 0.1)
            client.publish("/goto", 2)
            client.document("status", lambda each: "nobody takes /goto" in each["message"])
        with FoxgloveClient(port) as late:
            late.subscribe("/scene")
            for name in ("uav0", "uav1"):
                late.wait(
                    lambda name=name: any(
                        entity["id"] == f"{name}/cage"
                        for message in late.messages
                        for entity in message.json["entities"]
                    )
                )


def test_a_name_without_end_is_refused(port: int):
    with FoxgloveClient(port) as client:
        client.publish("/" + "x" * 300)
        client.document("status", lambda each: each["id"] == "topics")
        client.send("x" * 100_000)
        told = client.document("status", lambda each: each["id"] == "request")
        assert len(told["message"]) <= 1000


def test_watchers_do_not_keep_out_a_client_that_may_act(port: int):
    with ExitStack() as watchers:
        for _ in range(50):
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
    module, options = (
        "quadctl.services.bridges.foxglove",
        f'{{"host": "0.0.0.0", "port": {free_port()}}}',
    )
    process = lab.spawn(
        sys.executable, "-P", "-m", module, "--realm", lab.realm, "--options", options
    )
    assert process.wait() == 2
    assert "--host 0.0.0.0 lets other machines watch" in process.log


def test_the_layout_shows_what_the_bridge_offers(client: FoxgloveClient):
    layout = json.loads(LAYOUT.read_text(encoding="utf-8"))
    panels = layout["configById"]
    named: list[str] = []

    def collect(part: Any) -> None:
        if isinstance(part, str):
            named.append(part)
        else:
            collect(part["first"])
            collect(part["second"])

    collect(layout["layout"])
    assert sorted(named) == sorted(panels)
    for name, panel in panels.items():
        kind = name.partition("!")[0]
        if kind == "CallService":
            service = next(s for s in SERVICES if f"uav/{s.name}" == panel["serviceName"])
            request = json.loads(panel["requestPayload"])
            assert request.keys() <= json_schema(service.request)["properties"].keys()
        elif kind == "Plot":
            for path in panel["paths"]:
                topic, *fields = path["value"].split(".")
                message = client.message(topic)
                for field in fields:
                    message = message[field]
        elif kind == "RawMessages":
            assert panel["topicPath"] in client.channels
        elif kind == "3D":
            assert set(panel["topics"]) <= set(client.channels)


@pytest.mark.thorough
def test_up_supervises_a_bridge_with_the_options_of_its_file(tmp_path: Path):
    realm, port = f"foxglove-{os.getpid()}", free_port()
    words = f"{sys.executable} -m quadctl bridge foxglove --port {port}"
    file = tmp_path / "quad.toml"
    file.write_text(f"[processes]\nfoxglove = {json.dumps(words)}\n")
    command = [sys.executable, "-m", "quadctl"]
    up = ["up", str(file), "-d", "--realm", realm, "--bridge", "foxglove"]
    subprocess.run([*command, *up], check=True, timeout=60)
    try:
        status = [*command, "status", "--json", "--realm", realm]
        found = subprocess.run(status, check=True, capture_output=True, timeout=30)
        nodes = {node["name"]: node["state"] for node in json.loads(found.stdout)["nodes"]}
        assert nodes["foxglove"] == "ready"
        assert eventually(lambda: serves(port))
    finally:
        subprocess.run([*command, "down", "--realm", realm], check=True, timeout=60)
