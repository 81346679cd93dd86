"""Contract of the product, gathered as plain data: one function for each recorded file."""

import re
import tomllib
from collections.abc import Callable
from inspect import isclass, signature
from pathlib import Path
from typing import Any

from msgspec import NODEFAULT, Struct, inspect, json, to_builtins

from quadctl.schemas.zones import ZoneParams
from tests.golden import product

ROOT = Path(__file__).parents[2]
VEHICLE = "uav"


def keys() -> dict[str, Any]:
    """Gather the keys of topics, services, parameters and liveliness tokens."""
    offer = product.EndpointInfo(
        VEHICLE, "@pub", "safety", "SafetyState", "1a2b3c4d", 1.0, "uav/safety/state"
    )
    return {
        "nodes": list(product.NODES),
        "lab_nodes": dict(product.LAB_NODES),
        "topics": {
            topic.key(VEHICLE): {
                "type": topic.type.__name__,
                "node": topic.node,
                "hz": topic.hz,
                "latched": topic.latched,
            }
            for topic in product.all_topics()
        },
        "services": {
            service.key(VEHICLE): {
                "name": service.name,
                "type": service.type_name,
                "request": service.request.__name__,
                "response": service.response.__name__,
                "node": service.node,
                "reads": service.reads,
            }
            for service in product.all_services()
        },
        "tokens": {
            "node": product.node_key(VEHICLE, "safety"),
            "offer": product.endpoint_key(offer),
        },
    }


def messages() -> dict[str, Any]:
    """Gather the fields, schema hash and Zenoh encoding of every type on the wire."""
    return {name: _described(type_) for name, type_ in sorted(product.wire_types().items())}


def _described(type_: type[Struct]) -> dict[str, Any]:
    hashes = {"hash": product.schema_hash(type_), "encoding": product.encoding(type_)}
    return hashes | form(type_)


def form(type_: type[Struct]) -> dict[str, Any]:
    """Describe the fields of a type, and how they are encoded."""
    config = type_.__struct_config__
    return {
        "forbid_unknown_fields": config.forbid_unknown_fields,
        "omit_defaults": config.omit_defaults,
        "array_like": config.array_like,
        "fields": [_field(field) for field in fields(type_)],
    }


def _field(field: inspect.Field) -> dict[str, Any]:
    found: dict[str, Any] = {"name": field.encode_name, "type": product.type_name(field.type)}
    if bounds := product.bounds_text(field.type):
        found["bounds"] = bounds
    if not field.required:
        made = field.default_factory
        default = made() if made not in {NODEFAULT, None} else field.default
        found["default"] = to_builtins(default)
    return found


def fields(type_: type[Struct]) -> tuple[inspect.Field, ...]:
    """Return the fields of a struct."""
    described = inspect.type_info(type_)
    assert isinstance(described, inspect.StructType)
    return described.fields


def encoded() -> dict[str, Any]:
    """Encode one filled example of every type, and the errors and attachments of calls."""
    return {
        "types": {
            name: _example(type_)
            for name, type_ in sorted(product.wire_types().items())
            if name != "Error"  # sent only as JSON
        },
        "attachments": [
            _as_sent(product.Call(id="0123456789abcdef", deadline=1700000000.5)),
            _as_sent(product.Call(id="a", deadline=0.25, at=2.5)),
            _as_sent(product.Call(id="b" * 64, deadline=1e12, at=0.0, boot="boot")),
        ],
        "error_encoding": product.error_encoding,
        "errors": {
            code: product.encode_error(error(f"what {code}", "a hint")).decode()
            for code, error in sorted(product.wire_errors.items())
        },
        "error_without_hint": product.encode_error(product.QuadctlError("what")).decode(),
    }


def _as_sent(call: Any) -> dict[str, Any]:
    return {"value": json.decode(json.encode(call)), "hex": product.encode(call).hex()}


def _example(type_: type[Struct]) -> dict[str, Any]:
    from msgspec import convert

    value = {
        field.encode_name: _value(field.type, number) for number, field in enumerate(fields(type_))
    }
    return {"value": value, "hex": product.encode(convert(value, type_)).hex()}


def _value(type_: inspect.Type, number: int) -> Any:  # noqa: PLR0912 - a line a kind of type
    """Return a value that is not the default, and differs from field to field."""
    match type_:
        case inspect.Metadata():
            return _value(type_.type, number)
        case inspect.BoolType():
            return True
        case inspect.IntType():
            return 300 + number
        case inspect.FloatType():
            least = type_.ge if type_.ge is not None else type_.gt
            size = (number % 7 + 1) / 8
            return size if least is None or least >= 0 else -size
        case inspect.StrType():
            return f"text {number}"
        case inspect.LiteralType():
            return type_.values[-1]
        case inspect.ListType():
            return [_value(type_.item_type, number), _value(type_.item_type, number + 1)]
        case inspect.VarTupleType():
            return [_value(type_.item_type, number)]
        case inspect.StructType() if type_.cls is ZoneParams:
            # Not every value of every field makes a zone.
            return {"name": f"text {number}", "polygon": [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]}
        case inspect.DictType():
            return {"one": _value(type_.value_type, number), "two": _value(type_.value_type, 9)}
        case inspect.StructType():
            return {
                field.encode_name: _value(field.type, number + place)
                for place, field in enumerate(type_.fields)
            }
        case inspect.UnionType():
            some = [each for each in type_.types if not isinstance(each, inspect.NoneType)]
            return _value(some[0], number)
        case inspect.AnyType():
            return [1, 2.5, "any"]
    raise AssertionError(f"no example for {type_}")


def commands() -> dict[str, Any]:
    """Gather every command with its arguments and options, a line of text each."""
    found = {
        path: [*(["hidden"] if path in product.ALIASES else []), *map(_word, words)]
        for path, words in product.command_line().items()
    }
    names = {f"--{name}" for name in product.common_options()}
    common = [line for line in found["status"] if line.split()[1] in names]
    assert len(common) == len(names)
    return {
        "common": common,
        "commands": {
            path: [line for line in lines if line not in common] for path, lines in found.items()
        },
        "without_a_common_option": [
            path for path, lines in found.items() if not set(common) <= {*lines}
        ],
    }


def _word(word: Any) -> str:
    least = getattr(word.declaration, "min", None)
    default = str(word.default) if isinstance(word.default, Path) else word.default
    kind = word.type.__name__.lower() + (" range" if least is not None else "")
    kind = f"<{' '.join([kind] * word.count)}>" if word.count > 1 else kind
    metavar = word.declaration.metavar if word.is_option else word.placeholder
    facts = {
        "min": least,
        "default": None if word.type is bool else default,
        "metavar": metavar or None,
    }
    names = ", ".join(word.names) if word.is_option else word.name
    said = ["option" if word.is_option else "argument", names]
    said += ["<flag>" if word.type is bool else f"<{kind}>"]
    said += ["required"] if word.required else []
    said += ["many"] if word.many or word.count > 1 else []
    return " ".join(said + [f"{name}={fact!r}" for name, fact in facts.items() if fact is not None])


def parameters() -> dict[str, Any]:
    """Gather the tables and parameters of the TOML file, and the values that `init` writes."""
    return {
        "tables": product.tables(),
        "parameters": product.parameters(),
        "init": tomllib.loads(product.default_file()),
    }


def names() -> dict[str, Any]:
    """Gather extras, console scripts, faults, environment variables and errors."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {
        "distribution": project["name"],
        "extras": sorted(project["optional-dependencies"]),
        "console_scripts": sorted(project["scripts"]),
        "installed_scripts": sorted({entry.name for entry in product.console_scripts}),
        "faults": [
            {
                "name": fault.name,
                "node": fault.node,
                "parameter": fault.parameter,
                "value": fault.value,
                "sound": fault.sound,
            }
            for fault in product.FAULTS
        ],
        "faults_of_processes": {name: signal for name, (signal, _) in product.OF_PROCESSES.items()},
        "fault_of_the_bus": product.BUS_CUT,
        "environment": _environment(),
        "errors": _errors(product.QuadctlError),
    }


def _environment() -> list[str]:
    written = re.compile(r"\b_?QUADCTL_[A-Z_]*[A-Z]\b")
    texts = [file.read_text(encoding="utf-8") for file in product.source_files()]
    return sorted({name for text in texts for name in written.findall(text)})


def _errors(error: Any) -> dict[str, Any]:
    return {
        error.__name__: {
            "exit": error.exit_code,
            "code": error.code,
            "below": {
                name: fact
                for child in sorted(error.__subclasses__(), key=lambda child: child.__name__)
                if child.__module__ == error.__module__
                for name, fact in _errors(child).items()
            },
        }
    }


def python() -> dict[str, Any]:
    """Gather the public names of the package, with the members and parameters of each."""
    found = {name: _public(getattr(product.package, name)) for name in product.package.__all__}
    kinds = product.Topic, product.Service
    declared = vars(product.topics).items()
    return found | {
        "quadctl.schemas.topics": {
            name: repr(thing) for name, thing in declared if isinstance(thing, kinds)
        }
    }


def _public(thing: Any) -> dict[str, Any]:
    found = _parameters(thing)
    if isclass(thing):
        found["members"] = {
            name: _parameters(getattr(thing, name))
            for name in dir(thing)
            if not name.startswith("_") and not hasattr(Exception, name)
        }
    return found


def _parameters(thing: Any) -> dict[str, Any]:
    """Return the kind of each parameter, and which are required; nothing for an attribute."""
    if not callable(thing):
        return {}
    known = [each for each in signature(thing).parameters.values() if each.name[0] != "_"]
    return {
        "parameters": {
            each.name: "keyword" if each.kind is each.KEYWORD_ONLY else f"place {number}"
            for number, each in enumerate(known)
        },
        "required": " ".join(each.name for each in known if each.default is each.empty),
    }


DOCUMENTS: dict[str, Callable[[], dict[str, Any]]] = {
    gather.__name__: gather
    for gather in (keys, messages, encoded, commands, parameters, names, python)
}
"""Function that gathers each recorded file, by the file's name."""
