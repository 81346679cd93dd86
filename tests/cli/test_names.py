"""From what users type to topics and services."""

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from quadctl.cli.names import find_service, key_of
from quadctl.schemas.topics import SERVICES, TOPICS, topic_of
from quadctl.services.runtime.errors import Invalid

CHUNK = st.text("abcdefgh_1", min_size=1, max_size=8)


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_a_topic_by_name_or_key(topic):
    full = f"uav/{topic.name}"
    for name in (topic.name, f"/{topic.name}", full, f"/{full}", f"{topic.name}/"):
        assert key_of(name, "uav") == full
    assert key_of(topic.name, "drone") == f"drone/{topic.name}"
    assert topic_of(full) is topic
    assert topic_of(f"drone/{topic.name}") is topic


@pytest.mark.parametrize("name", ["uav/**", "other/pose", "camera/image", "**", "*/pose"])
def test_any_other_key_is_taken_as_it_is(name: str):
    assert key_of(name, "uav") == name
    assert key_of(f"/{name}", "uav") == name


@pytest.mark.parametrize("key", ["uav", "uav/nothing", "pose", "", "uav/@srv/goto"])
def test_a_key_that_is_no_topic(key: str):
    assert topic_of(key) is None


@pytest.mark.parametrize("service", SERVICES, ids=lambda service: service.name)
@settings(max_examples=20)
@given(vehicle=CHUNK)
def test_a_service_by_name_or_key(service, vehicle: str):
    name = service.name
    for spelling in (name, f"/{name}", f"@srv/{name}", service.key(vehicle), f"/{vehicle}/{name}"):
        assert find_service(spelling, vehicle) is service


@settings(max_examples=40)
@given(CHUNK, st.sampled_from(["get_params", "set_params"]), CHUNK)
def test_a_nodes_parameter_services(node: str, verb: str, vehicle: str):
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
def test_what_is_no_service_is_invalid_with_the_nearest_name(name: str, hint: str):
    with pytest.raises(Invalid, match=f"there is no service {name}") as caught:
        find_service(name, "uav")
    assert hint in caught.value.hint
