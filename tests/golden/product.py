"""Names of the product that the golden tests use: its only imports in this folder.

A redesign that moves modules changes this file and no other.
"""

from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

import quadctl as package
from quadctl import cli, schemas, services
from quadctl.cli.commands import ALIASES, COMMANDS, inside, words_at
from quadctl.cli.context import COMMON
from quadctl.cli.declarations import Parameter
from quadctl.cli.fault.catalogue import BUS_CUT, FAULTS, OF_PROCESSES
from quadctl.schemas import digests, topics
from quadctl.schemas.keyexpr import EndpointInfo, endpoint_key, node_key
from quadctl.schemas.services import Call, Error
from quadctl.schemas.topics import (
    GOTO,
    POSES,
    SERVICES,
    TOPICS,
    Service,
    Topic,
    called,
    get_params,
    set_params,
)
from quadctl.schemas.typeinfo import bounds_text, parts, schema_hash, type_name
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.errors import WIRE_ERRORS, QuadctlError
from quadctl.services.runtime.params import catalogue
from quadctl.services.runtime.params.names import LAB_NODES
from quadctl.services.runtime.process_table import NODES

__all__ = [
    "ALIASES",
    "BUS_CUT",
    "FAULTS",
    "LAB_NODES",
    "NODES",
    "OF_PROCESSES",
    "Call",
    "EndpointInfo",
    "Error",
    "QuadctlError",
    "Service",
    "Topic",
    "all_services",
    "all_topics",
    "bounds_text",
    "command_line",
    "common_options",
    "console_scripts",
    "decode",
    "decode_call",
    "decode_error",
    "default_file",
    "digests",
    "encode",
    "encode_error",
    "encoding",
    "endpoint_key",
    "error_encoding",
    "node_key",
    "package",
    "parameters",
    "parts",
    "request_type",
    "schema_hash",
    "sent_types",
    "source_files",
    "tables",
    "topics",
    "type_name",
    "wire_errors",
    "wire_types",
]  # fmt: skip

encode, encode_error, encoding = codec.encode, codec.encode_error, codec.encoding
decode, decode_call, decode_error = codec.decode, codec.decode_call, codec.decode_error
error_encoding = codec.ERROR_ENCODING
wire_errors = WIRE_ERRORS
default_file = catalogue.render
console_scripts = distribution("quadctl").entry_points


def all_topics() -> list[Topic[Any]]:
    """Return every topic, also those between nodes, and one of those that report service calls."""
    return [*TOPICS, POSES, called(GOTO)]


def all_services() -> list[Service[Any, Any]]:
    """Return every declared service, with the two parameter services of each node."""
    return [*SERVICES, *(make(node) for node in NODES for make in (get_params, set_params))]


def sent_types() -> list[type[Struct]]:
    """Return each message, request, response and envelope."""
    found: list[type[Struct]] = [topic.type for topic in all_topics()]
    for service in all_services():
        found += [service.request, service.response]
    return [*found, Call, Error]


def wire_types() -> dict[str, type[Struct]]:
    """Return by name each type that is sent, and each type inside one."""
    return {type_.__name__: type_ for sent in sent_types() for type_ in (sent, *parts(sent))}


def request_type(name: str) -> type[Struct]:
    """Return the request type of a service."""
    found: dict[str, type[Struct]] = {each.name: each.request for each in all_services()}
    return found[name]


def parameters() -> list[dict[str, Any]]:
    """Return every single parameter as it is declared."""
    return [
        {
            "name": leaf.name,
            "type": type_name(leaf.type),
            "unit": leaf.unit,
            "bounds": bounds_text(leaf.type),
            "default": msgspec.to_builtins(leaf.default),
            "fixed_at_launch": catalogue.fixed_at_launch(leaf.name),
        }
        for leaf in catalogue.leaves().values()
    ]


def tables() -> list[str]:
    """Return the dotted name of every table of the file."""
    return list(catalogue.tables())


def command_line(path: str = "") -> dict[str, list[Parameter]]:
    """Return by their paths the words, without `--help`, of a group and of all within it."""
    found = {path: words_at(path)[:-1]}
    for inner in inside(path).values():
        found |= {inner: words_at(inner)[:-1]} if inner in COMMANDS else command_line(inner)
    return found


def common_options() -> list[str]:
    """Return the names of the options that every command has."""
    return list(COMMON)


def source_files() -> list[Path]:
    """Return every Python file of the product."""
    folders = [Path(str(package.__file__)).parent for package in (cli, schemas, services)]
    return sorted(file for folder in folders for file in folder.rglob("*.py"))
