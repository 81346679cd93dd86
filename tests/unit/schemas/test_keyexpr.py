"""Liveliness tokens, and inclusion of key expressions as Zenoh enforces it."""

import pytest
import zenoh
from hypothesis import example, given, settings, strategies as st

from quadctl.schemas.keyexpr import (
    EndpointInfo,
    Kind,
    endpoint_key,
    includes,
    node_key,
    node_of,
    offer_of,
)

CHUNK = st.text("abcXYZ019_-.", min_size=1, max_size=12)
NAME = st.lists(CHUNK, min_size=1, max_size=4).map("/".join)
HZ = st.integers(0, 10_000).map(float) | st.sampled_from([0.5, 0.1, 12.5, 33.3333])
HASH = st.text("0123456789abcdef", min_size=8, max_size=8)
OFFER = offer_of("uav/@node/safety/@pub/SafetyState/1a2b3c4d/1/uav%safety%state")


@settings(max_examples=40)
@given(CHUNK, st.sampled_from(["@pub", "@sub"]), CHUNK, CHUNK, HASH, HZ, NAME)
def test_a_topics_token_round_trips(
    vehicle: str, kind: Kind, node: str, type_: str, digest: str, hz: float, name: str
):
    offer = EndpointInfo(vehicle, kind, node, type_, digest, hz, f"{vehicle}/{name}")
    key = endpoint_key(offer)
    assert offer_of(key) == offer
    assert key.count("/") == 7
    assert node_of(key) is None


@settings(max_examples=40)
@given(CHUNK, CHUNK, CHUNK, HASH, NAME)
def test_a_services_token_round_trips(vehicle: str, node: str, type_: str, digest: str, name: str):
    offer = EndpointInfo(vehicle, "@srv", node, type_, digest, 0.0, f"{vehicle}/@srv/{name}")
    assert offer_of(endpoint_key(offer)) == offer


@settings(max_examples=40)
@given(CHUNK, CHUNK)
def test_a_nodes_token_round_trips(vehicle: str, node: str):
    assert node_of(node_key(vehicle, node)) == node
    assert offer_of(node_key(vehicle, node)) is None


def test_the_tokens_are_those_of_the_contract():
    assert node_key("uav", "safety") == "uav/@node/safety"
    state = ("uav", "@pub", "safety", "SafetyState", "1a2b3c4d", 1.0, "uav/safety/state")
    assert EndpointInfo(*state) == OFFER
    goto = EndpointInfo("uav", "@srv", "safety", "Goto", "1a2b3c4d", 0.0, "uav/@srv/goto")
    assert endpoint_key(goto) == "uav/@node/safety/@srv/Goto/1a2b3c4d/0/uav%@srv%goto"


@pytest.mark.parametrize(
    "key",
    [
        "",
        "uav/pose",
        "uav/@node",
        "uav/@node/a/b",
        "uav/@node/a/@pub/T/00000000/1",
        "uav/@node/a/@pub/T/00000000/often/pose",
        "uav/@node/a/@own/T/00000000/1/pose",
        "uav/@node/a/@pub/T/00000000/1/pose/more",
    ],
)
def test_a_token_outside_the_grammar_is_ignored(key: str):
    assert offer_of(key) is None
    assert node_of(key) is None


@settings(max_examples=40)
@given(st.text("a1/@%$*#. nodepubsrv", max_size=60))
def test_no_key_raises_an_error(key: str):
    offer_of(key)
    node_of(key)


CHUNKS = st.sampled_from(
    ["uav", "uav7", "pose", "*", "**", "@srv", "@node", "own-a", "own-$*", "$*7", "a$*b", "ab"]
)
EXPRESSIONS = st.lists(CHUNKS, min_size=1, max_size=5).map("/".join)


def canonical(text: str) -> zenoh.KeyExpr:
    return zenoh.KeyExpr.autocanonize(text)


@given(EXPRESSIONS, EXPRESSIONS)
@example("*/**", "**")
@example("uav7/**", "uav7/@srv/goto")
@example("*/@node/own-$*", "uav/@node/own-camera")
@example("**", "uav/@srv/**")
def test_inclusion_agrees_with_zenoh(pattern: str, key: str):
    ours, theirs = canonical(pattern), canonical(key)
    assert includes(str(ours), str(theirs)) == ours.includes(theirs)
