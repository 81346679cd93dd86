"""Tables of docs/reference/ from the declarations: commands, parameters, exit codes, types, files."""

import textwrap
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
from msgspec import inspect

from quadctl.cli.commands import ALIASES, COMMANDS, GROUPS, command
from quadctl.cli.context import COMMON
from quadctl.cli.declarations import Parameter, words_of
from quadctl.cli.fault.catalogue import FAULTS
from quadctl.cli.lab.rubric import EXPECTATIONS, RubricRow
from quadctl.cli.mission.mission import KINDS
from quadctl.schemas.topics import SERVICES, TOPICS, Topic
from quadctl.schemas.typeinfo import bounds_text, definition, fields, service_definition
from quadctl.services.runtime import errors
from quadctl.services.runtime.params import catalogue

_EXAMPLE = "Example: "
_LAB = Path(__file__).parents[1] / "cli" / "lab"


def commands() -> str:
    """Return a section for each command, and the options that all of them take."""
    lines, group = ["## Options of every command", "", *_table(_common())], ""
    for path in COMMANDS:
        if path in ALIASES:
            continue
        noun, _, _ = path.rpartition(" ")
        if noun and noun != group:
            lines += [f"## {noun}", "", GROUPS[noun], ""]
        group = noun
        lines += _command(path, "###" if noun else "##")
    return "\n".join(lines).rstrip() + "\n"


def _command(path: str, level: str) -> list[str]:
    function = command(path)
    about, _, example = textwrap.dedent(f"    {function.__doc__}").partition(_EXAMPLE)
    rows = [(_word(word), word.declaration.about + _default(word)) for word in words_of(function)]
    lines = [f"{level} {path}", "", about.strip(), ""]
    if example:
        lines += ["```text", f"$ {example.strip()}", "```", ""]
    return [*lines, *_table(rows)]


def _common() -> Iterator[tuple[str, str]]:
    for name, (_, about) in COMMON.items():
        yield f"`--{name}`", about


def _word(word: Parameter) -> str:
    if not word.is_option:
        return f"`{word.placeholder}`"
    value = "" if word.type is bool else f" {word.placeholder}"
    return f"`{', '.join(word.names)}{value}`"


def _default(word: Parameter) -> str:
    default = "" if "default" in word.declaration.about else word.shown_default
    return f" Default: {default}." if default else ""


def _table(rows: Any) -> list[str]:
    cells = [f"| {name} | {_cell(about)} |" for name, about in rows]
    return ["| word | meaning |", "|---|---|", *cells, ""] if cells else []


def _cell(text: str) -> str:
    return text.replace("|", r"\|")


def parameters() -> str:
    """Return a table of each section of quad.toml: default, unit, bounds, and when it may change."""
    lines: list[str] = []
    for section in catalogue.sections():
        if not section.entries:
            continue
        lines += [f"## {section.name}", "", f"{section.about}.", ""]
        lines += [
            "| parameter | default | unit | bounds | meaning | changed |",
            "|---|---|---|---|---|---|",
        ]
        for entry in section.entries:
            live = "at launch" if catalogue.fixed_at_launch(entry.name) else "in flight"
            bounds = "" if isinstance(entry.type, inspect.StructType) else bounds_text(entry.type)
            default = f"`{catalogue.value(entry.default)}`"
            cells = f"`{entry.name}`", default, entry.unit, bounds, entry.about, live
            lines.append(f"| {' | '.join(map(_cell, cells))} |")
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def exit_codes() -> str:
    """Return each error with its exit code, its name in `--json`, and its meaning."""
    lines = ["| exit | name | class | meaning |", "|---|---|---|---|", "| 0 | | | Done. |"]
    root = errors.QuadctlError
    found = [
        each for each in vars(errors).values() if isinstance(each, type) and issubclass(each, root)
    ]
    for error in sorted(found, key=lambda each: each.exit_code):
        about = (
            (error.__doc__ or "").partition("\n")[0] if error is not root else "Unexpected error."
        )
        lines.append(f"| {error.exit_code} | `{error.code}` | `{error.__name__}` | {about} |")
    lines += ["| 8 | | | A command that looks for faults has found one. |", "| 130 | | | Ctrl-C. |"]
    return "\n".join(lines) + "\n"


def keys() -> str:
    """Return the table of the keys of a vehicle, here `uav`."""
    rows = [
        (
            f"`{topic.key('uav')}`",
            topic.type.__name__,
            topic.node or "anyone",
            _rate(topic),
            topic.doc,
        )
        for topic in TOPICS
    ]
    rows += [
        (f"`{service.key('uav')}`", service.type_name, service.node, "", service.doc)
        for service in SERVICES
    ]
    rows += [
        ("`uav/@srv/NODE/get_params`, `set_params`", "GetParams, SetParams", "every node", "", ""),
        ("`uav/@call/SERVICE`", "Called", "the server", "", "An executed call and its outcome."),
    ]
    head = ["| key | type | from | rate | |", "|---|---|---|---|---|"]
    return "\n".join([*head, *(f"| {' | '.join(row)} |" for row in rows)]) + "\n"


def files() -> str:
    """Return the tables of the rows of missions and rubrics, and of what a row may expect."""
    lines = ["### Rows of a mission", "", "| `do` | keys | meaning |", "|---|---|---|"]
    for kind, step in KINDS.items():
        keys = ", ".join(f"`{field.encode_name}`{_otherwise(field)}" for field in fields(step))
        lines.append(f"| `{kind}` | {keys} | {step.__doc__} |")
    lines += ["", "### Rows of a rubric", "", "| key | default | meaning |", "|---|---|---|"]
    for field in fields(RubricRow):
        about = catalogue.annotation(field.type, "description")
        if about:
            default = _otherwise(field).strip(" ()") or "needed"
            lines.append(f"| `{field.encode_name}` | {default} | {about} |")
    lines += ["", "### Expectations", "", "| `expect` | holds if | further keys |", "|---|---|---|"]
    for name, each in EXPECTATIONS.items():
        further = "; ".join(f"`{key}`: {default}" for key, default in each.keys.items())
        lines.append(f"| `{name}` | {each.holds} | {further} |")
    return "\n".join(lines) + "\n"


def graded() -> str:
    """Return the table of the rows of the built-in rubric, and of those that it may be extended by."""
    lines = ["| row | points | what it tests |", "|---|---|---|"]
    for name in ("rubric", "hidden", "extra"):
        tables = tomllib.loads((_LAB / f"{name}.toml").read_text(encoding="utf-8"))["row"]
        lines += [
            f"| {row['number']} | {row.get('points', 1.0):g} | {row['name']} |" for row in tables
        ]
    return "\n".join(lines) + "\n"


def _otherwise(field: inspect.Field) -> str:
    """Return the default of a field in brackets; empty if it is needed."""
    if field.required:
        return ""
    factory = field.default_factory
    default = field.default if factory is msgspec.NODEFAULT else factory()
    return " (none)" if default is None else f" (`{msgspec.json.encode(default).decode()}`)"


def faults() -> str:
    """Return the table of the faults that can be injected, with the parameters that cause them."""
    rows = [
        (f"`{each.name}`", each.about, f"`{each.parameter}`", f"`{each.size}`" if each.size else "")
        for each in FAULTS
    ]
    head = ["| fault | effect | parameter | SIZE |", "|---|---|---|---|"]
    return "\n".join([*head, *(f"| {' | '.join(row)} |" for row in rows)]) + "\n"


def _rate(topic: Topic[Any]) -> str:
    rate = f"{topic.hz:g} Hz" if topic.hz else ""
    if topic.latched:
        return f"on change{f', and {rate}' if rate else ''}; `get` returns the last one"
    return rate


def types() -> str:
    """Return every message and service as `type show` prints it, with its meaning."""
    shown: dict[str, tuple[str, str]] = {}
    for topic in TOPICS:
        shown.setdefault(topic.type.__name__, (topic.type.__doc__ or "", definition(topic.type)))
    for service in SERVICES:
        about = f"{service.request.__doc__ or ''}\n\n{service.response.__doc__ or ''}"
        shown[service.name] = about, service_definition(service.request, service.response)
    lines: list[str] = []
    for name, (about, text) in shown.items():
        words = [" ".join(part.split()) for part in about.split("\n\n") if part.strip()]
        lines += [f"### {name}", "", *(line for word in words for line in (word, ""))]
        lines += ["```text", text, "```", ""]
    return "\n".join(lines).rstrip() + "\n"
