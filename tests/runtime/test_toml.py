"""Values as TOML, in files and on command lines, read back as they were."""

import tomllib
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quadctl.schemas.params import Params
from quadctl.services.runtime.params import catalogue
from quadctl.services.runtime.params.names import flatten, value_of

TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
SCALAR = st.one_of(
    st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False), TEXT
)
VALUE = st.recursive(
    SCALAR, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3)
)


@settings(max_examples=60)
@given(VALUE)
def test_a_value_in_a_file_is_read_back(value: Any):
    assert tomllib.loads(f"value = {catalogue.value(value)}") == {"value": value}


@settings(max_examples=60)
@given(VALUE)
def test_what_get_prints_set_takes(value: Any):
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
        ("", '""'),
        (" padded", '" padded"'),
        ("two\nlines", r'"two\nlines"'),
        ([], "[]"),
        ({"x": 1.0, "y z": "a"}, '{ x = 1.0, "y z" = "a" }'),
    ],
)
def test_as_a_word(value: Any, text: str):
    assert catalogue.word(value) == text


def test_a_word_is_one_value_and_no_more():
    assert value_of("1\nother = 2") == "1\nother = 2"


def test_a_document_holds_every_parameter_below_its_table():
    values = dict(flatten(msgspec.to_builtins(Params(processes={"a": "run 'x'", "b": ["y", ""]}))))
    text = catalogue.document(values)
    assert dict(flatten(tomllib.loads(text))) == values
    assert "[safety.virtual_cage]\nx = 5.0\n" in text
    assert "[safety]\nacceptance_range = 0.5\n" in text
    assert catalogue.document({"safety.takeoff": 2.0}) == "[safety]\ntakeoff = 2.0\n"
