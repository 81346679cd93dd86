"""Topics and services from the names that users type."""

import pytest
import zenoh
from hypothesis import assume, example, given, settings, strategies as st

from quadctl.cli.names import checked_key, find_service, key_of, single_key
from quadctl.schemas.topics import SERVICES, TOPICS, topic_of
from quadctl.services.runtime.errors import Invalid, UsageError
from quadctl.services.runtime.realm import vehicle_name
from tests.support.command_line import Quadctl

ODD = st.text(st.sampled_from("ab/*$@#?{}~%: é\n"), max_size=8) | st.text(
    st.characters(exclude_categories=["Cs"]), max_size=12
)


def canonical(text: str) -> str | None:
    """Return the canonical spelling of a key expression, or None if Zenoh rejects it."""
    while "$*$*" in text:
        # Zenoh 1.10 panics on it behind any other character, e.g. `a$*$*`.
        text = text.replace("$*$*", "$*")
    try:
        return str(zenoh.KeyExpr.autocanonize(text))
    except zenoh.ZError:
        return None


@settings(max_examples=400)
@given(ODD)
@example("a/***")
@example("?$*$*")
@example(":$*$*")
@example("$*")
@example("$*$*")
@example("a/$*/**/b")
@example("**/**/*/$*/x")
@example("**/*")
@example("a$*$*b/@c")
@example("@$*")
@example("info")
def test_a_checked_key_is_canonical_for_zenoh(name: str):
    bare = name.strip("/")
    try:
        key = checked_key(name, "uav")
    except Invalid:
        assert canonical(bare) is None
    else:
        # A known topic may be named without its vehicle.
        assert canonical(key_of(name, "uav")) == key == str(zenoh.KeyExpr(key))


@settings(max_examples=100)
@given(ODD)
def test_a_single_key_has_no_wildcard(name: str):
    try:
        key = single_key(name, "uav")
    except Invalid:
        return
    assert not any(char in str(zenoh.KeyExpr(key)) for char in "*$#?")


@settings(max_examples=100)
@given(ODD, st.sampled_from(["get_params", "set_params"]))
@example("a$b", "get_params")
@example("*", "get_params")
@example("x" * 70_000, "get_params")
def test_a_nodes_service_has_a_valid_key(node: str, verb: str):
    try:
        service = find_service(f"{node}/{verb}", "uav")
    except Invalid:
        return
    key = zenoh.KeyExpr(service.key("uav"))
    assert "*" not in str(key)
    assert len(str(key)) < 1000


@settings(max_examples=100)
@given(ODD)
def test_a_vehicle_name_is_a_valid_key_prefix(name: str):
    try:
        vehicle = vehicle_name(name)
    except UsageError:
        return
    assert str(zenoh.KeyExpr(f"{vehicle}/pose")) == f"{vehicle}/pose"


def test_a_key_too_long_for_the_wire_is_rejected():
    with pytest.raises(Invalid, match="is not a valid key"):
        checked_key("a" * 70_000, "uav")


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("topic echo a/***", 6),
        ("topic hz a$b", 6),
        ("topic info uav/**", 6),
        ("topic pub uav/* 1", 6),
        ("topic pub a//b 1", 6),
        ("service call a$b/get_params []", 6),
        ("service call */get_params []", 6),
        ("service info */get_params", 6),
        ("--vehicle a$b topic list", 2),
        ("--vehicle * topic list", 2),
        ("topic echo **/*", 3),
    ],
)
def test_an_invalid_key_is_rejected_before_any_call(quadctl: Quadctl, line: str, code: int):
    result = quadctl(*line.split())
    assert (result.code, result.out) == (code, "")
    assert result.err.startswith("error: ")


CHUNK = st.text("abcdefgh_1", min_size=1, max_size=8)


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_a_topic_is_found_by_name_or_key(topic):
    full = f"uav/{topic.name}"
    for name in (topic.name, f"/{topic.name}", full, f"/{full}", f"{topic.name}/"):
        assert key_of(name, "uav") == full
    assert key_of(topic.name, "drone") == f"drone/{topic.name}"
    assert topic_of(full) is topic
    assert topic_of(f"drone/{topic.name}") is topic


@pytest.mark.parametrize("name", ["uav/**", "other/pose", "camera/image", "**", "*/pose"])
def test_any_other_key_is_unchanged(name: str):
    assert key_of(name, "uav") == name
    assert key_of(f"/{name}", "uav") == name


@pytest.mark.parametrize("key", ["uav", "uav/nothing", "pose", "", "uav/@srv/goto"])
def test_a_key_that_is_no_topic_is_not_found(key: str):
    assert topic_of(key) is None


@pytest.mark.parametrize("service", SERVICES, ids=lambda service: service.name)
@settings(max_examples=20)
@given(vehicle=CHUNK)
def test_a_service_is_found_by_name_or_key(service, vehicle: str):
    name = service.name
    for spelling in (name, f"/{name}", f"@srv/{name}", service.key(vehicle), f"/{vehicle}/{name}"):
        assert find_service(spelling, vehicle) is service


@settings(max_examples=40)
@given(CHUNK, st.sampled_from(["get_params", "set_params"]), CHUNK)
def test_a_nodes_parameter_services_are_found(node: str, verb: str, vehicle: str):
    assume(node != vehicle)
    for spelling in (f"{node}/{verb}", f"/{node}/{verb}", f"{vehicle}/@srv/{node}/{verb}"):
        found = find_service(spelling, vehicle)
        assert (found.node, found.name) == (node, f"{node}/{verb}")


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("calibrate_presure", "did you mean calibrate_pressure?"),
        ("/toggle_cag", "did you mean toggle_cage?"),
        ("other/@srv/goto", "`quadctl service list`"),
        ("get_params", ""),
        ("zzzzzzzzzzzz", "`quadctl service list`"),
        ("", "`quadctl service list`"),
    ],
)
def test_an_unknown_service_gets_the_nearest_name_as_a_hint(name: str, hint: str):
    with pytest.raises(Invalid, match=f"there is no service {name}") as caught:
        find_service(name, "uav")
    assert hint in caught.value.hint
