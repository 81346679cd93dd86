"""A parameter's value, in each of the notations that users come with."""

from typing import Any

import pytest

from quadctl.cli.values import parameter
from quadctl.services.runtime.params import catalogue

CAGE = {"x": 3, "y": 2.5, "z": 3}


@pytest.mark.parametrize(
    "text",
    [
        "{ x = 3, y = 2.5, z = 3 }",
        "{x: 3, y: 2.5, z: 3}",
        '{"x": 3, "y": 2.5, "z": 3}',
        '{"x":3,"y":2.5,"z":3}',
        " {'x': 3, 'y': 2.5, 'z': 3}",
    ],
)
def test_a_table(text: str):
    assert parameter(text) == CAGE


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3", 3),
        ("True", True),
        ("wide", "wide"),
        ("a: b", "a: b"),
        ("[1, 2]", [1, 2]),
        ("[a, b]", ["a", "b"]),
        ("{x: 3", "{x: 3"),
        ('"{x: 3}"', "{x: 3}"),
        ("", ""),
    ],
)
def test_anything_else(text: str, value: Any):
    assert parameter(text) == value


@pytest.mark.parametrize("text", ["{x: 3}", "[a, b]", "{", "plain", "[]", "{ x = 3 }"])
def test_a_text_is_read_as_the_same_text_that_get_prints(text: str):
    assert parameter(catalogue.word(text)) == text
