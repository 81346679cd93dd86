"""Parameters say what they are, and the file in the repository is the one that is written."""

import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from msgspec import Struct, inspect, to_builtins

from quadctl.schemas.params import FIXED_AT_LAUNCH, CageParams, Params, SafetyParams
from quadctl.services.runtime.params import catalogue
from quadctl.services.runtime.params.load import load
from quadctl.services.runtime.params.names import flatten
from tests.schemas.declared import bare, fields

FILE = Path(__file__).parents[2] / "quad.toml"
TEXT = FILE.read_text(encoding="utf-8")


def settable(type_: type[Struct], path: str = "") -> Iterator[tuple[str, inspect.Type]]:
    """Every parameter, a described table such as the cage counting as one."""
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
def test_every_parameter_stands_in_the_file_below_its_meaning(name: str):
    table, _, key = name.rpartition(".")
    lines = TEXT.splitlines()
    section = lines[lines.index(f"[{table}]") :]
    number = next(n for n, line in enumerate(section) if line.startswith(f"{key} = "))
    about = section[number - 1]
    meta = SETTABLE[name]
    assert isinstance(meta, inspect.Metadata)
    meaning = str((meta.extra_json_schema or {})["description"])
    assert about.lower().startswith(f"# {meaning.lower()}: ")
    assert str((meta.extra or {})["unit"]) in about
    assert "default " in about


def test_the_file_is_what_init_writes():
    assert catalogue.render() == TEXT


def test_it_names_every_parameter_and_no_other():
    written = {name for name, _ in flatten(tomllib.loads(TEXT))}
    assert written == {name for name, _ in flatten(to_builtins(Params()))}


def test_it_loads_with_the_labs_values():
    params = load(FILE)
    assert params.safety == SafetyParams(acceptance_range=0.5, virtual_cage=CageParams(5, 5, 2))
    assert params.safety.cage_on
    assert params == catalogue.lab_params()


def test_beside_the_labs_cage_it_is_the_defaults_in_code():
    lab, code = (dict(flatten(to_builtins(p))) for p in (load(FILE), Params()))
    assert {name: lab[name] for name in lab if lab[name] != code[name]} == {
        "safety.virtual_cage.z": 2.0
    }
    assert code["safety.virtual_cage.z"] == 5.0


def test_what_is_fixed_at_launch_is_a_parameter():
    assert {name for name, _ in flatten(to_builtins(Params()))} >= FIXED_AT_LAUNCH
