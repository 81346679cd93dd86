"""The codec and the frozen hashes against rosbags, which has an implementation of its own."""

import dataclasses
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from quadctl.services.ros2 import cdr, messages
from quadctl.services.ros2.cdr import Malformed

STORE: Any = get_typestore(Stores.ROS2_JAZZY)
DEFINITIONS = {
    "std_srvs/srv/SetBool": ("bool data", "bool success\nstring message"),
    "std_srvs/srv/Trigger": ("", "bool success\nstring message"),
    "rcl_interfaces/srv/GetParameters": ("string[] names", "ParameterValue[] values"),
    "rcl_interfaces/srv/GetParameterTypes": ("string[] names", "uint8[] types"),
    "rcl_interfaces/srv/DescribeParameters": (
        "string[] names",
        "ParameterDescriptor[] descriptors",
    ),
    "rcl_interfaces/srv/SetParameters": (
        "Parameter[] parameters",
        "SetParametersResult[] results",
    ),
    "rcl_interfaces/srv/SetParametersAtomically": (
        "Parameter[] parameters",
        "SetParametersResult result",
    ),
    "rcl_interfaces/srv/ListParameters": (
        "string[] prefixes\nuint64 depth",
        "ListParametersResult result",
    ),
}
EMPTY: Any = [("structure_needs_at_least_one_member", (Nodetype.BASE, ("uint8", 0)))]


def register(definition: str, name: str) -> None:
    """Register a definition; in a service's, names without a package are those of messages."""
    package = name.partition("/")[0]
    for short in ("ParameterValue", "ParameterDescriptor", "Parameter", "SetParametersResult",
                  "ListParametersResult"):  # fmt: skip
        definition = "\n".join(
            f"{package}/msg/{line}" if line.split("[")[0].split(" ")[0] == short else line
            for line in definition.split("\n")
        )
    found = get_types_from_msg(definition, f"{package}/msg/{name.rpartition('/')[2]}")
    definitions: Any = found.values()
    ((_, fields),) = definitions
    STORE.register({f"{package}/msg/{name.rpartition('/')[2]}": ([], fields or EMPTY)})
    STORE.fielddefs[name] = ([], fields or EMPTY)


for service, (request, response) in DEFINITIONS.items():
    register(request, f"{service}_Request")
    register(response, f"{service}_Response")

PAIRS = [(each.message, each.name) for each in messages.TYPES]
for each in messages.SERVICES:
    short = each.name.replace("/srv/", "/msg/")
    PAIRS += [(each.request, f"{short}_Request"), (each.response, f"{short}_Response")]
NAMES = [name for _, name in PAIRS]


def values_of(hint):
    """Return a strategy of values of a field's type."""
    text = st.text(max_size=20).filter(lambda text: "\0" not in text)
    if get_origin(hint) is Annotated:
        code = get_args(hint)[1]
        if code == "?":
            return st.booleans()
        if isinstance(code, int):
            return st.floats(-1e9, 1e9).map(lambda first: tuple(first + n for n in range(code)))
        if code in "fd":
            return st.floats(allow_nan=False, width=32 if code == "f" else 64)
        size = np.dtype(code).itemsize * 8
        low = 0 if code.isupper() else -(2 ** (size - 1))
        return st.integers(low, low + 2**size - 1)
    if hint is str:
        return text
    if hint is bytes:
        return st.binary(max_size=9)
    if get_origin(hint) is tuple:
        return st.lists(values_of(get_args(hint)[0]), max_size=3).map(tuple)
    fields = get_type_hints(hint, include_extras=True)
    return st.builds(hint, **{name: values_of(of) for name, of in fields.items()})


def plain(value):
    """Return a message of ours or of rosbags as nested tuples."""
    if isinstance(value, msgspec.Struct):
        return tuple(plain(getattr(value, name)) for name in value.__struct_fields__)
    if dataclasses.is_dataclass(value):
        fields = [each.name for each in dataclasses.fields(value)]
        return tuple(plain(getattr(value, name)) for name in fields if name[0].islower())
    if isinstance(value, np.ndarray):
        # rosbags reads a byte as a signed number.
        return tuple((value.view("u1") if value.dtype == "i1" else value).tolist())
    if isinstance(value, bytes):
        return tuple(value)
    if isinstance(value, list | tuple):
        return tuple(plain(each) for each in value)
    return value


@pytest.mark.thorough
@pytest.mark.parametrize(("type_", "name"), PAIRS, ids=NAMES)
def test_rosbags_reads_what_we_write_and_we_read_what_it_writes(type_, name):
    @settings(max_examples=40)
    @given(values_of(type_))
    def check(message):
        payload = cdr.encode(message)
        theirs = STORE.deserialize_cdr(payload, name)
        assert plain(theirs) == plain(message)
        again = bytes(STORE.serialize_cdr(theirs, name))
        assert again.ljust(len(payload), b"\0") == payload
        assert cdr.decode(type_, again) == message

    check()


@pytest.mark.thorough
@pytest.mark.parametrize(("type_", "name"), PAIRS, ids=NAMES)
def test_garbage_is_refused_or_read_but_nothing_else_happens(type_, name):
    @given(st.binary(max_size=200), st.booleans())
    def check(garbage, headed):
        payload = b"\0\1\0\0" * headed + garbage
        try:
            message = cdr.decode(type_, payload)
        except Malformed:
            return
        assert isinstance(message, type_)

    check()


@pytest.mark.thorough
@pytest.mark.parametrize(("type_", "name"), PAIRS, ids=NAMES)
def test_a_payload_cut_short_is_refused(type_, name):
    @settings(max_examples=40)
    @given(values_of(type_), st.data())
    def check(message, data):
        payload = cdr.encode(message)
        cut = data.draw(st.integers(0, len(payload) - 1))
        with pytest.raises(Malformed):
            cdr.decode(type_, payload[:cut])

    check()


def test_a_count_beyond_the_payload_allocates_nothing():
    with pytest.raises(Malformed, match="a count is 4294967295"):
        cdr.decode(messages.Names, b"\0\1\0\0\xff\xff\xff\xff")


@pytest.mark.parametrize("type_", messages.TYPES, ids=lambda each: each.name)
def test_the_hash_of_a_message_is_that_of_rosbags(type_):
    assert STORE.hash_rihs01(type_.name) == f"RIHS01_{type_.hash}"


@pytest.mark.parametrize("service", messages.SERVICES, ids=lambda each: each.name)
def test_the_hash_of_a_service_is_that_of_its_three_messages(service):
    def named(what, bound=None):
        of = (Nodetype.NAME, what)
        return of if bound is None else (Nodetype.SEQUENCE, (of, bound))

    request, response = f"{service.name}_Request", f"{service.name}_Response"
    STORE.fielddefs["service_msgs/msg/ServiceEventInfo"] = (
        [],
        [
            ("event_type", (Nodetype.BASE, ("uint8", 0))),
            ("stamp", named("builtin_interfaces/msg/Time")),
            ("client_gid", (Nodetype.ARRAY, ((Nodetype.BASE, ("uint8", 0)), 16))),
            ("sequence_number", (Nodetype.BASE, ("int64", 0))),
        ],
    )
    STORE.fielddefs[f"{service.name}_Event"] = (
        [],
        [
            ("info", named("service_msgs/msg/ServiceEventInfo")),
            ("request", named(request, 1)),
            ("response", named(response, 1)),
        ],
    )
    STORE.fielddefs[service.name] = (
        [],
        [
            ("request_message", named(request)),
            ("response_message", named(response)),
            ("event_message", named(f"{service.name}_Event")),
        ],
    )
    assert STORE.hash_rihs01(service.name) == f"RIHS01_{service.hash}"
