"""Documents and frames of Foxglove, and the sites whose pages may connect."""

import json
import struct
from typing import Any

import pytest
from hypothesis import given, strategies as st

from quadctl.schemas.keyexpr import EndpointInfo
from quadctl.services.bridges.foxglove.protocol import (
    ClientAdvertise,
    ClientChannel,
    ClientMessage,
    ClientSubscription,
    FoxgloveParameter,
    GetParameters,
    Graph,
    ServiceCall,
    Subscribe,
    document,
    may_watch,
    message_frame,
    request_of,
    response_frame,
)
from quadctl.services.runtime.errors import Invalid


@pytest.mark.parametrize(
    ("text", "request_"),
    [
        ('{"op": "subscribe", "subscriptions": [{"id": 0, "channelId": 3}]}',
         Subscribe([ClientSubscription(0, 3)])),
        ('{"op": "advertise", "channels": [{"id": 1, "topic": "/goto", "schemaName": "a"}]}',
         ClientAdvertise([ClientChannel(1, "/goto")])),
        ('{"op": "getParameters", "parameterNames": [], "id": "a"}', GetParameters([], "a")),
        ('{"op": "getParameters"}', GetParameters()),
    ],
)  # fmt: skip
def test_documents_of_clients_are_read(text: str, request_: Any):
    assert request_of(text) == request_


def test_frames_are_little_endian():
    assert request_of(b"\x01\x02\0\0\0abc") == ClientMessage(2, b"abc")
    call = b"\x02" + struct.pack("<III", 3, 4, 4) + b"json{}"
    assert request_of(call) == ServiceCall(3, 4, "json", b"{}")
    assert message_frame(5, 7, b"{}") == b"\x01\x05\0\0\0\x07\0\0\0\0\0\0\0{}"
    response = b"\x03" + struct.pack("<III", 3, 4, 4) + b"json[]"
    assert response_frame(ServiceCall(3, 4, "json", b"{}"), b"[]") == response


@pytest.mark.parametrize(
    "data",
    ['{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 3}]}',
     '{"op": "subscribe", "subscriptions": [{"id": 4294967296, "channelId": 3}]}', "{}", "[]", '{"op": "no such"}', '{"op": "subscribe"}', "[" * 5000, b"", b"\x01", b"\x07abcdefg",
     b"\x02" + struct.pack("<III", 1, 1, 99) + b"json"],
)  # fmt: skip
def test_garbage_is_refused(data: str | bytes):
    with pytest.raises(Invalid, match="Foxglove"):
        request_of(data)


@given(st.text(max_size=60) | st.binary(max_size=60))
def test_any_garbage_is_a_request_or_refused(data: str | bytes):
    try:
        request_of(data)
    except Invalid:
        return


def shown(value: Any) -> dict[str, Any]:
    text = document("parameterValues", parameters=[FoxgloveParameter.of("a", value)], id="")
    found = json.loads(text)
    assert [*found] == ["op", "parameters"]
    parameter: dict[str, Any] = found["parameters"][0]
    return parameter


def test_parameters_have_the_types_that_json_loses():
    plain = [shown(value) for value in (2.0, 2, [0.5, 1.0], [], True, [1, 2])]
    assert [each.get("type") for each in plain] == [
        "float64", None, "float64_array", None, None, None,
    ]  # fmt: skip
    assert "type" in shown(0.0)


def endpoint(kind: Any, node: str, key: str) -> EndpointInfo:
    return EndpointInfo("uav", kind, node, "Pose", "0a", 1.0, key)


PUBLISHED = endpoint("@pub", "dynamics", "uav/pose")
SUBSCRIBED = [endpoint("@sub", "safety", "uav/pose"), endpoint("@sub", "pressure", "uav/pose")]
SERVED = endpoint("@srv", "safety", "uav/@srv/goto")
NONE = Graph({}, {}, {})


def test_the_graph_has_the_nodes_of_each_topic_and_service():
    graph = Graph.of([PUBLISHED, *SUBSCRIBED, SERVED])
    assert graph.published == {"uav/pose": ["uav/dynamics"]}
    assert graph.subscribed == {"uav/pose": ["uav/safety", "uav/pressure"]}
    assert graph.served == {"uav/goto": ["uav/safety"]}


def test_an_update_of_the_graph_removes_what_is_gone():
    whole = Graph.of([PUBLISHED, *SUBSCRIBED, SERVED])
    gone = NONE.update(whole)
    assert (gone["removedTopics"], gone["removedServices"]) == (["uav/pose"], ["uav/goto"])
    unpublished = Graph.of(SUBSCRIBED).update(whole)
    assert unpublished["publishedTopics"] == [{"name": "uav/pose", "publisherIds": []}]
    assert unpublished["removedTopics"] == []
    assert whole.update(NONE)["advertisedServices"] == [
        {"name": "uav/goto", "providerIds": ["uav/safety"]}
    ]


@pytest.mark.parametrize(
    ("origin", "may"),
    [
        ("", True),  # a program
        ("file://", True),  # a desktop app
        ("http://localhost:8080", True),
        ("https://127.0.0.1", True),
        ("http://[::1]:3000", True),
        ("https://app.foxglove.dev", True),
        ("http://lab:8080", True),
        ("http://lab", False),
        ("null", False),  # any site's sandboxed frame
        ("https://example.org", False),
        ("http://localhost.example.org", False),
        ("http://localhost:8080.example.org", False),
        ("https://app.foxglove.dev.example.org", False),
        ("HTTP://example.org", False),
    ],
)
def test_pages_of_foreign_sites_may_not_watch(origin: str, may: bool):
    assert may_watch(origin, ["http://lab:8080"]) is may
