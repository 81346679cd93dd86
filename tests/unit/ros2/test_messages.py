"""Payloads and hashes of ROS's messages, read by another package and compared with published ones."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from quadctl.services.bridges.ros2 import messages
from quadctl.services.bridges.ros2.messages import Malformed, RosService

STORE: Any = get_typestore(Stores.ROS2_JAZZY)
SERVICES = [each for each in vars(messages).values() if isinstance(each, RosService)]
HASHES = {
    "geometry_msgs/msg/PoseStamped": "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    "nav_msgs/msg/Odometry": "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "sensor_msgs/msg/FluidPressure": "22dfb2b145a0bd5a31a1ac3882a1b32148b51d9b2f3bab250290d66f3595bc32",
    "visualization_msgs/msg/MarkerArray": "86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
    "std_msgs/msg/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "rosgraph_msgs/msg/Clock": "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
}
"""Hashes as ROS 2 Jazzy has them."""
NAMES = [*HASHES, *(name for each in SERVICES for name in (each.request, each.response))]
_DEFINITIONS: dict[str, str] = {}


def blank(type_: Any) -> Any:
    """Return a strategy of messages of one of rosbags' types."""
    fields = messages._STORE.fielddefs[type_.__msgtype__][1]
    return st.builds(type_, *(values_of(each) for _, each in fields))


def values_of(field: Any) -> Any:
    kind, of = field
    if kind == Nodetype.NAME:
        return blank(messages._STORE.types[of])
    if kind == Nodetype.ARRAY:
        return st.just(np.arange(of[1], dtype=np.float64))
    if kind == Nodetype.SEQUENCE:
        item, _ = of
        if item[0] == Nodetype.BASE and item[1][0] != "string":
            dtype = np.dtype({"bool": "?", "byte": "uint8"}.get(item[1][0], item[1][0]))
            return st.lists(values_of(item), max_size=3).map(lambda made: np.array(made, dtype))
        return st.lists(values_of(item), max_size=3)
    name = of[0]
    if name == "string":
        return st.text(max_size=20).filter(lambda text: "\0" not in text)
    if name == "bool":
        return st.booleans()
    if name.startswith("float"):
        return st.floats(allow_nan=False, width=32 if name == "float32" else 64)
    if name == "byte":
        return st.integers(0, 127)  # rosbags reads a byte as a signed number
    limits = np.iinfo(name)
    return st.integers(int(limits.min), int(limits.max))


def plain(value: Any) -> Any:
    """Return a message of any package as nested tuples."""
    if isinstance(value, np.ndarray):
        return tuple(value.tolist())
    if isinstance(value, bytes | bytearray | list | tuple):
        return tuple(plain(each) for each in value)
    names = vars(type(value)).get("__slots__")
    if dataclasses.is_dataclass(value):
        names = [each.name for each in dataclasses.fields(value)]
    if names is None or isinstance(value, str):
        return value
    # Both packages have the constants of a message beside its fields, and one has no empty message's.
    shown = [name for name in names if name[0].islower() and not name.startswith("structure_needs")]
    return tuple(plain(getattr(value, name)) for name in shown)


def read_elsewhere(name: str, payload: bytes) -> Any:
    """Return the message of a payload as the package mcap-ros2-support reads it."""
    text, _ = messages._STORE.generate_msgdef(name, ros_version=2)
    schema = Schema(id=1, data=text.encode(), encoding="ros2msg", name=name)
    decode = DecoderFactory().decoder_for("cdr", schema)
    assert decode is not None
    return decode(payload)


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES)
def test_another_package_reads_what_we_write_and_so_do_we(name):
    @settings(max_examples=20)
    @given(blank(messages._STORE.types[name]))
    def check(message):
        payload = messages.encode(message)
        assert plain(read_elsewhere(name, payload)) == plain(message)
        assert plain(messages.decode(name, payload)) == plain(message)

    check()


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES)
def test_garbage_is_refused_or_read_but_nothing_else_happens(name):
    @settings(max_examples=40)
    @given(st.binary(max_size=200), st.booleans())
    def check(garbage, headed):
        payload = b"\0\1\0\0" * headed + garbage
        try:
            message = messages.decode(name, payload)
        except Malformed:
            return
        assert message.__msgtype__ == name

    check()


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES)
def test_a_payload_cut_short_is_refused(name):
    @settings(max_examples=20)
    @given(blank(messages._STORE.types[name]), st.data())
    def check(message, data):
        payload = messages.encode(message)
        cut = data.draw(st.integers(0, len(payload) - 1))
        with pytest.raises(Malformed):
            messages.decode(name, payload[:cut])

    check()


def test_a_count_beyond_the_payload_allocates_nothing():
    with pytest.raises(Malformed, match="4294967295"):
        messages.decode(messages.GET_PARAMETERS.request, b"\0\1\0\0\xff\xff\xff\xff")


@pytest.mark.parametrize("name", HASHES)
def test_the_hash_of_a_message_is_that_of_ros(name):
    assert messages.type_hash(name) == HASHES[name]


@pytest.mark.parametrize("service", SERVICES, ids=lambda each: each.name)
def test_the_hash_of_a_service_is_that_of_its_three_messages(service):
    def named(what, bound=None):
        of = (Nodetype.NAME, what)
        return of if bound is None else (Nodetype.SEQUENCE, (of, bound))

    request, response = f"{service.name}_Request", f"{service.name}_Response"
    for name, ours in ((request, service.request), (response, service.response)):
        STORE.fielddefs[name] = messages._STORE.fielddefs[ours]
    info = "uint8 event_type\nbuiltin_interfaces/msg/Time stamp\nuint8[16] client_gid\nint64 sequence_number"
    STORE.fielddefs |= get_types_from_msg(info, "service_msgs/msg/ServiceEventInfo")
    event = [
        ("info", named("service_msgs/msg/ServiceEventInfo")),
        ("request", named(request, 1)),
        ("response", named(response, 1)),
    ]
    STORE.fielddefs[f"{service.name}_Event"] = ([], event)
    parts = [
        ("request_message", named(request)),
        ("response_message", named(response)),
        ("event_message", named(f"{service.name}_Event")),
    ]
    STORE.fielddefs[service.name] = ([], parts)
    assert STORE.hash_rihs01(service.name) == f"RIHS01_{service.hash}"
