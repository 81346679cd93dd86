"""Zenoh's access control configuration, evaluated as Zenoh does, against the table of roles."""

from collections.abc import Sequence
from typing import Any

from hypothesis import given, strategies as st

from quadctl.schemas.keyexpr import includes
from quadctl.schemas.roles import ROLES, Right, Role, may, node_may
from quadctl.schemas.topics import SERVICES, TOPICS
from quadctl.services.runtime.security.access_control import (
    access_control,
    for_nodes,
    groups,
    member,
)
from quadctl.services.runtime.security.identity import Name

NOW = 1_000.0
NAMES = [topic.name for topic in TOPICS] + [f"@srv/{service.name}" for service in SERVICES]
NAMES += ["@srv/safety/set_params", "@srv/hub/get_params", "own/x", "@srv/own/x", "@call/goto"]
NAMES += ["@node/safety", "@node/own-x", "@node/gate", "**", "@srv/*", "input/*", "*", "@adv/x"]
VEHICLES = ["uav", "uav7", "uav8", "*"]
KEYS = st.builds("{}/{}".format, st.sampled_from(VEHICLES), st.sampled_from(NAMES))
INCOMING: dict[str, set[Right]] = {
    "put": {"publish"}, "declare_subscriber": {"listen"}, "query": {"call", "read"},
    "declare_queryable": {"serve"}, "reply": {"serve"}, "liveliness_token": {"announce"},
}  # fmt: skip
"""Rights that permit a message from a holder, any one of them."""
OUTGOING: dict[str, set[Right]] = {
    "put": {"listen"}, "reply": {"call", "read"}, "query": {"serve"}, "liveliness_token": {"see"},
}  # fmt: skip
"""Rights that permit a message to a holder, any one of them."""


def holder_of(role: Role, vehicles: Sequence[str], serial: str = "1", expires: float = 2_000.0):
    return Name("anna", role, list(vehicles), serial, expires)


HOLDERS = st.builds(
    holder_of,
    st.sampled_from(list(ROLES)),
    st.lists(st.sampled_from(["uav", "uav7"]), min_size=1, max_size=2, unique=True)
    | st.just(["*"]),
)


def passes(config: dict[str, Any], who: dict[str, str], flow: str, message: str, key: str) -> bool:
    """Return Zenoh's decision, with denials first.

    A subject matches by all of its fields, a rule by a key that includes the message's.
    """
    subjects = {
        subject["id"]
        for subject in config["subjects"]
        if who.get("cert", "") in subject.get("cert_common_names", [who.get("cert", "")])
        and who.get("link", "") in subject.get("link_protocols", [who.get("link", "")])
        and who.get("user", "") in subject.get("usernames", [who.get("user", "")])
    }
    wanted = {
        rule
        for policy in config["policies"]
        if subjects & set(policy["subjects"])
        for rule in policy["rules"]
    }
    assert config["default_permission"] == "deny"
    permissions = {
        rule["permission"]
        for rule in config["rules"]
        if rule["id"] in wanted
        and flow in rule["flows"]
        and message in rule["messages"]
        and any(includes(pattern, key) for pattern in rule["key_exprs"])
    }
    return permissions == {"allow"}


@given(HOLDERS, KEYS)
def test_the_rules_allow_exactly_the_rights_of_a_role(holder: Name, key: str):
    config = access_control([holder, holder_of("student", ["uav8"], "2")], NOW, "unixsock-stream")
    who = {"cert": holder.common_name, "link": "tls"}
    for flow, table in (("ingress", INCOMING), ("egress", OUTGOING)):
        for message, rights in table.items():
            due = any(may(holder.role, holder.vehicles, right, key) for right in rights)
            # A hub may subscribe to everything: it receives only its own vehicles' messages.
            asks = holder.role == "hub" and (flow, message) == ("ingress", "declare_subscriber")
            if not asks:
                assert passes(config, who, flow, message, key) == due, (flow, message)
    assert not passes(config, who, "ingress", "delete", key)


@given(st.sampled_from(["safety", "pressure"]), KEYS)
def test_a_user_that_is_a_node_has_the_rights_of_its_name(node: str, key: str):
    config = for_nodes("us", ["safety", "pressure"])
    for flow, table in (("ingress", INCOMING), ("egress", OUTGOING)):
        for message, rights in table.items():
            due = any(node_may(node, right, key) for right in rights)
            assert passes(config, {"user": node}, flow, message, key) == due, (flow, message)
            ours = "@adv" not in key
            assert passes(config, {"user": "us"}, flow, message, key) is ours, (flow, message)
            assert not passes(config, {"user": "other"}, flow, message, key)


@given(HOLDERS, KEYS, st.sampled_from([*INCOMING, *OUTGOING, "delete", "liveliness_query"]))
def test_an_unlisted_or_expired_certificate_is_denied_everything(
    holder: Name, key: str, message: str
):
    late = holder_of(holder.role, holder.vehicles, "9", expires=NOW)
    config = access_control([late, holder_of("operator", ["*"], "2")], NOW, "unixsock-stream")
    for serial in ("9", "1"):
        cert = holder_of(holder.role, holder.vehicles, serial).common_name
        for flow in ("ingress", "egress"):
            assert not passes(config, {"cert": cert, "link": "tls"}, flow, message, key)
    assert not passes(config, {"link": "tls"}, "ingress", message, key)


@given(KEYS)
def test_local_sockets_are_allowed_everything_but_advanced_keys(key: str):
    config = access_control([], NOW, "unixsock-stream")
    if "@adv" not in key:
        assert passes(config, {"link": "unixsock-stream"}, "ingress", "query", key)
        assert passes(config, {"link": "unixsock-stream"}, "egress", "put", key)


def test_many_holders_of_one_role_are_one_subject():
    many = [holder_of("student", ["uav"], str(number)) for number in range(100)]
    config = access_control(many, NOW, "unixsock-stream")
    assert len(config["subjects"]) == 1 + 2 * len(ROLES)  # our hub; the roles of uav and of all
    ids = [rule["id"] for rule in config["rules"]]
    assert len(ids) == len(set(ids))


@given(HOLDERS, KEYS)
def test_a_certificate_of_the_door_has_the_rights_of_its_group(holder: Name, key: str):
    config = access_control([holder], NOW, "unixsock-stream")
    ours = member(holder.role, holder.vehicles, 2_000.0)
    for flow in ("ingress", "egress"):
        for message in (*INCOMING, *OUTGOING, "liveliness_query"):
            both = {
                passes(config, {"cert": name.common_name, "link": "tls"}, flow, message, key)
                for name in (holder, ours)
            }
            assert len(both) == 1


def test_a_new_member_of_one_vehicle_needs_no_new_group():
    before = groups([holder_of("hub", ["uav"])], NOW).keys()
    joined = [holder_of("hub", ["uav"]), holder_of("student", ["uav"], "2")]
    assert groups(joined, NOW).keys() == before
    both = [*joined, holder_of("student", ["uav", "uav7"], "3")]
    assert groups(both, NOW).keys() > before


def test_subscriptions_are_announced_only_to_the_hubs_concerned():
    names = [holder_of("hub", [name], name) for name in ("uav7", "uav8")]
    config = access_control([*names, holder_of("hub", ["*"], "1")], NOW, "unixsock-stream")
    who = {"cert": names[0].common_name, "link": "tls"}
    for key in ("uav7/pose", "uav7/@call/goto", "*/pose", "**", "uav9/pose"):
        assert passes(config, who, "egress", "declare_subscriber", key), key
    for key in ("uav8/pose", "uav8/input/position", "uav8/@call/goto", "uav8/**"):
        assert not passes(config, who, "egress", "declare_subscriber", key), key
    teacher = {"cert": "hub.anna.1", "link": "tls"}
    assert passes(config, teacher, "egress", "declare_subscriber", "uav8/pose")
