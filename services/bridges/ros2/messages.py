"""Messages of ROS 2 that the bridge exchanges, and their codec.

The package rosbags has ROS's own messages with their fields, their codec (CDR 1, as rmw_zenoh carries
them) and their type hashes. It has no services: their fields are those of std_srvs and rcl_interfaces,
and their hashes are frozen here, which are the same from Jazzy on.
"""

from typing import Any, NamedTuple

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

_STORE = get_typestore(Stores.ROS2_JAZZY)


class Malformed(ValueError):
    """Payload that is not CDR of the expected type."""


class RosService(NamedTuple):
    """Type of a service: its name in ROS, its hash (RIHS01), and the names of its messages' types."""

    name: str
    hash: str
    request: str
    response: str


def encode(message: Any) -> bytes:
    """Return the payload of a message; raise struct.error for a number out of its range."""
    return bytes(_STORE.serialize_cdr(message, message.__msgtype__))


def decode(type_name: str, payload: bytes) -> Any:
    """Return the message of a payload; raise Malformed if it is not one of this type."""
    try:
        return _STORE.deserialize_cdr(payload, type_name)
    except SerdeError as error:
        raise Malformed(f"the payload is no {type_name}: {error}") from error


def type_hash(type_name: str) -> str:
    """Return the hash of a topic's type, 64 hexadecimal digits."""
    return _STORE.hash_rihs01(type_name).removeprefix("RIHS01_")


def message(type_name: str, *fields: Any) -> Any:
    """Return a message of a type by its name, e.g. `std_srvs/msg/SetBool_Response`, with its fields."""
    return _STORE.types[type_name](*fields)


def _service(name: str, digest: str, request: str, response: str) -> RosService:
    """Register the messages of a service, given as in its .srv file."""
    package, _, short = name.split("/")
    types = [f"{package}/msg/{short}_{part}" for part in ("Request", "Response")]
    for type_name, fields in zip(types, (request, response), strict=True):
        _STORE.register(get_types_from_msg(fields, type_name))
    return RosService(name, digest, *types)


_EMPTY = "uint8 structure_needs_at_least_one_member"
"""Byte that CDR has for an empty message."""
_OUTCOME = "bool success\nstring message"

SET_BOOL = _service(
    "std_srvs/srv/SetBool",
    "abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a",
    "bool data", _OUTCOME,
)  # fmt: skip
TRIGGER = _service(
    "std_srvs/srv/Trigger",
    "eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
    _EMPTY, _OUTCOME,
)  # fmt: skip
GET_PARAMETERS = _service(
    "rcl_interfaces/srv/GetParameters",
    "bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc",
    "string[] names", "ParameterValue[] values",
)  # fmt: skip
GET_PARAMETER_TYPES = _service(
    "rcl_interfaces/srv/GetParameterTypes",
    "da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca",
    "string[] names", "uint8[] types",
)  # fmt: skip
DESCRIBE_PARAMETERS = _service(
    "rcl_interfaces/srv/DescribeParameters",
    "845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff",
    "string[] names", "ParameterDescriptor[] descriptors",
)  # fmt: skip
SET_PARAMETERS = _service(
    "rcl_interfaces/srv/SetParameters",
    "56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0",
    "Parameter[] parameters", "SetParametersResult[] results",
)  # fmt: skip
SET_PARAMETERS_ATOMICALLY = _service(
    "rcl_interfaces/srv/SetParametersAtomically",
    "0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd",
    "Parameter[] parameters", "SetParametersResult result",
)  # fmt: skip
LIST_PARAMETERS = _service(
    "rcl_interfaces/srv/ListParameters",
    "3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d",
    "string[] prefixes\nuint64 depth", "ListParametersResult result",
)  # fmt: skip
