"""The vehicle in Foxglove, seen and flown by a client of its protocol."""

import asyncio
import json
import os
import random
import signal
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from math import dist
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zenoh
from websockets.asyncio.client import connect as secure
from websockets.exceptions import InvalidMessage, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

import quadctl
from quadctl.cli.bridge.foxglove import LAYOUT
from quadctl.schemas.topics import SERVICES, TOPICS
from quadctl.schemas.typeinfo import json_schema
from quadctl.services.runtime.bus import session
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.bus.session import free_port
from quadctl.services.runtime.realm import Realm
from tests.support import missions
from tests.support.foxglove import (
    OLD_SUBPROTOCOL,
    SUBPROTOCOL,
    TOKEN,
    FoxgloveClient,
    ServiceFailed,
    bridge,
    bridged,
    request,
    response,
    serves,
)
from tests.support.lab import Lab, private_lab
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
def test_the_labs_four_checkpoints_are_flown_through_it(client: FoxgloveClient, run: quadctl.Run):
    baseline = client.call("uav/calibrate_pressure", zero=True)["baseline"]
    assert 1013 < baseline < 1014
    assert client.call("uav/toggle_cage", cage_on=True) == {"success": True}
    assert client.call("uav/goto", x=1, y=2, z=1.5) == {"accepted": True, "reason": ""}
    client.message("uav/pose", lambda pose: dist(at(pose), (1, 2, 1.5)) < 0.1)
    client.message("uav/safety/state", lambda state: state["state"] == "HOVERING")
    refused = client.call("uav/goto", x=9, y=0, z=1)
    reason = "outside the cage: x = 9 is beyond [-5, 5]"
    assert refused == {"accepted": False, "reason": reason}
    assert run.vehicle.state().reason in refused["reason"]


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


def test_calls_sent_back_to_back_keep_their_order(client: FoxgloveClient, run: quadctl.Run):
    for _ in range(10):
        calls = [
            client.request("uav/toggle_cage", json.dumps({"cage_on": on}).encode())
            for on in (False, True)
        ]
        for number in calls:
            assert client.answer(number) == {"success": True}
        assert run.vehicle.state().cage_on
    key = "uav/@call/toggle_cage"
    client.wait(lambda: len([m for m in client.messages if m.topic == key]) >= 18)
    executed = [m.json["request"]["cage_on"] for m in client.messages if m.topic == key]
    assert all(one != other for one, other in pairwise(executed))


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
@pytest.mark.parametrize(("options", "token"), [((), TOKEN), (("--control",), "")])
def test_without_control_or_token_nothing_can_be_changed(options: tuple[str, ...], token: str):
    port = free_port()
    with (
        quadctl.launch() as other,
        bridge(other.realm, port, *options),
        FoxgloveClient(port, token=token) as client,
    ):
        before, limit = other.vehicle.state(), other.vehicle.params["safety.takeoff"]
        with pytest.raises(ServiceFailed, match=r"this client may only watch: .*bridge foxglove"):
            client.call("uav/hold")
        name = "uav.safety.takeoff"
        assert client.set_parameters(**{name: 2.0})[name]["value"] == limit
        client.document("status", lambda each: each["id"] == "parameters")
        client.publish("/goto")(b'{"x": 1, "y": 0, "z": 1}')
        client.document("status", lambda each: each["id"] == "/goto")
        # What is published is handled before what is requested later.
        client.parameters(name)
        after = other.vehicle.state()
        assert (after.request, after.goal) == (before.request, before.goal)
        assert other.vehicle.params["safety.takeoff"] == limit


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
def test_garbage_by_the_thousand_changes_nothing(port: int, run: quadctl.Run):
    run.vehicle.settle()  # a hold of an earlier test moves its goal until the vehicle rests
    before, noise = run.vehicle.state(), random.Random(7)
    with FoxgloveClient(port) as client:
        publish = client.publish("/goto")
        for _ in range(2000):
            publish(noise.randbytes(noise.randrange(120)))
        for _ in range(50):
            number = client.request("uav/toggle_cage", noise.randbytes(noise.randrange(40)) + b"}")
            with pytest.raises(ServiceFailed):
                client.answer(number)
        client.send("setParameters", parameters=[{"name": "a.b.c", "value": {"x": [None, 1]}}])
        client.send("no such operation")
        client.document("status", lambda each: each["id"] == "request")
    for _ in range(50):
        with FoxgloveClient(port) as client:
            client.send_bytes(noise.randbytes(noise.randrange(1, 60)))
    after = run.vehicle.state()
    seen = [(state.goal, state.request, state.cage_on) for state in (before, after)]
    assert seen[0] == seen[1]
    with FoxgloveClient(port) as client:
        assert client.call("uav/hold") == {"success": True}


@pytest.mark.thorough
def test_the_flight_is_the_same_whatever_happens_to_the_bridge():
    port = free_port()
    with private_lab() as lab:
        missions.start(lab, "dynamics.speed=10")
        alone = missions.same(missions.fly(lab))
        with (
            bridged(lab, port, "--control") as process,
            FoxgloveClient(port, everything=True) as client,
        ):
            client.message("uav/pose")
            publish = client.publish("/goto")
            flown = missions.fly_beside(lab, process, lambda: publish(b"[" * 100))
    assert flown == dict.fromkeys(flown, alone)


@pytest.mark.thorough
def test_the_hub_may_go_and_come_back(lab: Lab):
    lab.start()
    port = free_port()
    with bridged(lab, port, "--control"), FoxgloveClient(port, everything=True) as client:
        client.message("uav/pose")
        lab.revived("hub", lab.signal("hub", signal.SIGKILL))
        client.message("uav/pose")
        assert client.call("uav/hold") == {"success": True}


@pytest.mark.thorough
def test_a_bridge_has_the_rights_of_its_certificate(lab: Lab):
    for words in ("init", "issue hub", "issue student anna --vehicle uav"):
        assert lab.quadctl("keys", *words.split()).code == 0
    hub, port = f"tls/127.0.0.1:{free_port()}", free_port()
    lab.start("--listen", hub, "--identity", "keys/hub")
    options = ("--control", "--connect", hub, "--identity", "keys/anna", "--json")
    with bridged(lab, port, *options) as process, FoxgloveClient(port) as client:
        assert client.call("uav/hold") == {"success": True}
        with pytest.raises(ServiceFailed, match="not allowed: a student of uav may not call"):
            client.call("uav/toggle_cage", cage_on=False)
        told = json.loads(process.log.splitlines()[0])
    assert told == {
        "address": f"ws://127.0.0.1:{port}/?token={TOKEN}",
        "watch": f"ws://127.0.0.1:{port}/",
        "layout": str(LAYOUT),
        "vehicles": ["uav"],
    }


@pytest.mark.thorough
def test_a_certificate_encrypts_it(lab: Lab):
    for words in ("init", "issue hub"):
        assert lab.quadctl("keys", *words.split()).code == 0
    lab.start()
    port, keys = free_port(), lab.folder / "keys" / "hub"
    options = ("--host", "0.0.0.0", "--cert", keys / "cert.pem", "--key", keys / "key.pem")
    trusting = ssl.create_default_context(cafile=keys / "ca.pem")
    trusting.check_hostname = False
    with bridged(lab, port, "--control", *map(str, options)):
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
