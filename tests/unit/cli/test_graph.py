"""`graph`: topics with their publishers and subscribers, also in Graphviz's language."""

import re

from msgspec.structs import replace

from quadctl.cli.graph import as_dot, described
from quadctl.schemas.keyexpr import EndpointInfo, Kind


def endpoint(kind: Kind, node: str, key: str, hz: float = 0.0) -> EndpointInfo:
    return EndpointInfo("uav", kind, node, "Pose", "1a2b3c4d", hz, key)


FOUND = [
    endpoint("@pub", "dynamics", "uav/pose", 100),
    endpoint("@sub", "safety", "uav/pose", 20),
    endpoint("@sub", "pressure", "uav/pose", 20),
    endpoint("@sub", "safety", "uav/own/a"),
]


def test_each_topic_is_described_once_at_its_publishers_rate():
    own, pose = described(FOUND)
    assert (own["publishers"], own["subscribers"]) == ([], ["safety"])
    assert (pose["publishers"], pose["subscribers"]) == (["dynamics"], ["pressure", "safety"])
    assert pose["declared_hz"] == 100


def test_the_drawing_has_an_arrow_for_each_publisher_and_subscriber():
    text = "\n".join(as_dot(described(FOUND)))
    arrows = re.findall(r'"(.*)" -> "(.*)";', text)
    assert sorted(arrows) == [
        ("uav node dynamics", "uav/pose"),
        ("uav/own/a", "uav node safety"),
        ("uav/pose", "uav node pressure"),
        ("uav/pose", "uav node safety"),
    ]
    assert '[shape=box, label="uav/pose\\n100 Hz"]' in text
    assert text.count("{") == text.count("}") == 2


def test_the_first_vehicle_is_drawn_last_which_graphviz_puts_on_top():
    found = [replace(FOUND[0], vehicle=name, key=f"{name}/pose") for name in ("uav0", "uav1")]
    assert re.findall('cluster (.*)"', "\n".join(as_dot(described(found)))) == ["uav1", "uav0"]


def test_a_strangers_name_cannot_leave_its_quotes():
    (line,) = (
        line for line in as_dot(described([endpoint("@pub", 'a"b\\', "uav/x")])) if "->" in line
    )
    assert line == '    "uav node a\\"b\\\\" -> "uav/x";'
