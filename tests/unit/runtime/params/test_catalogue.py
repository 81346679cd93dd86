"""Catalogue of parameters, and their values as TOML in files and on command lines."""

import tomllib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings, strategies as st
from msgspec import Struct, inspect, to_builtins

from quadctl.schemas.params import FIXED_AT_LAUNCH, CageParams, Params, SafetyParams
from quadctl.schemas.typeinfo import bounds_text
from quadctl.services.runtime.params import catalogue
from quadctl.services.runtime.params.load import load
from quadctl.services.runtime.params.names import flatten, value_of
from tests.golden.data import HOW
from tests.support.declared_types import bare, fields


def test_the_catalogue_has_every_parameter_in_order_with_its_default():
    defaults = dict(flatten(msgspec.to_builtins(Params())))
    found = {name: leaf.default for name, leaf in catalogue.leaves().items()}
    assert found == defaults
    sections = [name.rpartition(".")[0] for name in found]
    assert sections.index("safety") < sections.index("dynamics") < sections.index("supervise")


def test_every_parameter_has_its_own_meaning_or_its_tables():
    leaves = catalogue.leaves()
    assert all(leaf.about for leaf in leaves.values())
    z = leaves["safety.virtual_cage.z"]
    assert (z.unit, bounds_text(z.type)) == ("m", "[0.2, 10000]")
    assert z.about == catalogue.tables()["safety.virtual_cage"]


def test_every_table_has_a_meaning():
    tables = {name.rpartition(".")[0] for name in catalogue.leaves()} - {""}
    assert tables <= set(catalogue.tables())
    assert all(catalogue.tables().values())


@pytest.mark.parametrize(
    "name", [*sorted(FIXED_AT_LAUNCH), "supervise.answer_timeout", "processes.x"]
)
def test_parameters_fixed_at_launch_are_known(name: str):
    assert catalogue.fixed_at_launch(name)
    assert not catalogue.fixed_at_launch("safety.takeoff")


FILE = Path(__file__).parents[4] / "quad.toml"
DEFAULTS = FILE.read_text(encoding="utf-8")


def settable(type_: type[Struct], path: str = "") -> Iterator[tuple[str, inspect.Type]]:
    """Yield every parameter; a described table such as the cage counts as one."""
    for field in fields(type_):
        name = f"{path}.{field.encode_name}".lstrip(".")
        inner = bare(field.type)
        table = isinstance(inner, inspect.StructType)
        if table and not isinstance(field.type, inspect.Metadata):
            assert isinstance(inner, inspect.StructType)
            yield from settable(inner.cls, name)
        elif name != "processes":
            yield name, field.type


SETTABLE = dict(settable(Params))


@pytest.mark.parametrize("name", SETTABLE)
def test_every_parameter_has_a_meaning_and_a_unit(name: str):
    type_ = SETTABLE[name]
    assert isinstance(type_, inspect.Metadata)
    assert (type_.extra_json_schema or {}).get("description")
    assert "unit" in (type_.extra or {})


@pytest.mark.parametrize("name", SETTABLE)
def test_the_file_has_every_parameter_below_its_meaning(name: str):
    table, _, key = name.rpartition(".")
    lines = DEFAULTS.splitlines()
    section = lines[lines.index(f"[{table}]") :]
    # Zones are tables of their own, so the file has an example in comments.
    begins = "# [[safety.zones]]" if name == "safety.zones" else f"{key} = "
    number = next(n for n, line in enumerate(section) if line.startswith(begins))
    about = section[number - 1]
    meta = SETTABLE[name]
    assert isinstance(meta, inspect.Metadata)
    meaning = str((meta.extra_json_schema or {})["description"])
    assert about.lower().startswith(f"# {meaning.lower()}: ")
    assert str((meta.extra or {})["unit"]) in about
    assert "default " in about


def test_the_file_is_what_init_writes():
    assert catalogue.render() == DEFAULTS, HOW


def test_the_file_has_exactly_the_declared_parameters():
    written = {name for name, _ in flatten(tomllib.loads(DEFAULTS))}
    assert written == {name for name, _ in flatten(to_builtins(Params()))} - {"safety.zones"}


def test_the_file_loads_with_the_labs_values():
    params = load(FILE)
    assert params.safety == SafetyParams(acceptance_range=0.5, virtual_cage=CageParams(5, 5, 2))
    assert params.safety.cage_on
    assert params == catalogue.lab_params()


def test_except_for_the_cage_the_file_has_the_defaults_of_the_code():
    lab, code = (dict(flatten(to_builtins(p))) for p in (load(FILE), Params()))
    assert {name: lab[name] for name in lab if lab[name] != code[name]} == {
        "safety.virtual_cage.z": 2.0
    }
    assert code["safety.virtual_cage.z"] == 5.0


def test_every_name_fixed_at_launch_is_a_parameter():
    assert {name for name, _ in flatten(to_builtins(Params()))} >= FIXED_AT_LAUNCH


TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
SCALAR = st.one_of(
    st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False), TEXT
)
VALUE = st.recursive(
    SCALAR, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3)
)


@settings(max_examples=60)
@given(VALUE)
def test_a_value_in_a_file_reads_back_the_same(value: Any):
    assert tomllib.loads(f"value = {catalogue.value(value)}") == {"value": value}


@settings(max_examples=60)
@given(VALUE)
def test_set_accepts_the_output_of_get(value: Any):
    read = value_of(catalogue.word(value))
    assert read == value
    assert type(read) is type(value)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (True, "true"),
        (3.0, "3.0"),
        (1e-5, "1e-05"),
        ("auto", "auto"),
        ("two words", "two words"),
        ("true", '"true"'),
        ("True", '"True"'),
        ("3", '"3"'),
        (".5", '".5"'),
        ("007", '"007"'),
        ("", '""'),
        (" padded", '" padded"'),
        ("two\nlines", r'"two\nlines"'),
        ([], "[]"),
        ({"x": 1.0, "y z": "a"}, '{ x = 1.0, "y z" = "a" }'),
    ],
)
def test_a_value_is_formatted_as_a_word(value: Any, text: str):
    assert catalogue.word(value) == text


def as_python(text: str) -> int | float | str:
    """Return the number that Python reads in a text, else the text."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text


@settings(max_examples=400)
@given(st.text("-+0179._e", min_size=1, max_size=7))
def test_a_number_is_read_as_toml_reads_it_or_else_as_python_does(text: str):
    found = value_of(text)
    try:
        expected = tomllib.loads(f"value = {text}")["value"]
    except ValueError:
        expected = text if "_" in text else as_python(text)
    assert (type(found), str(found)) == (type(expected), str(expected))


def test_a_word_with_two_lines_is_one_text():
    assert value_of("1\nother = 2") == "1\nother = 2"


def test_a_document_has_every_parameter_below_its_table():
    values = dict(flatten(msgspec.to_builtins(Params(processes={"a": "run 'x'", "b": ["y", ""]}))))
    text = catalogue.document(values)
    assert dict(flatten(tomllib.loads(text))) == values
    assert "[safety.virtual_cage]\nx = 5.0\n" in text
    assert "[safety]\nacceptance_range = 0.5\n" in text
    assert catalogue.document({"safety.takeoff": 2.0}) == "[safety]\ntakeoff = 2.0\n"
