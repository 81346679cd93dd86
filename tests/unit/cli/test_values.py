"""Messages on a command line, in our own syntax and in rostopic's YAML."""

import json
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given, strategies as st

from quadctl.cli import values
from quadctl.cli.topic.pub import Payload, payload_of
from quadctl.cli.values import message_of, parameter, table_of, without_type
from quadctl.schemas.messages import Setpoint, Waypoint
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.errors import Invalid, UsageError
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
def test_a_table_is_read_in_every_spelling(text: str):
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
def test_other_values_are_read_as_toml_or_text(text: str, value: Any):
    assert parameter(text) == value


@pytest.mark.parametrize("text", ["{x: 3}", "[a, b]", "{", "plain", "[]", "{ x = 3 }"])
def test_a_text_printed_by_get_reads_back_the_same(text: str):
    assert parameter(catalogue.word(text)) == text


REQUEST = "uav/input/position_request"
SETPOINT = "boot=b for_seq=1 position.x=1 position.y=2 position.z=3 brake=false"


@pytest.mark.parametrize(
    "words",
    [
        ["x=1", "y=-.5", "z=2."],
        ["1", "-0.5", "2"],
        ['{"x": 1, "y": -0.5, "z": 2}'],
        ["{x: 1, y: -.5, z: 2.0}"],
        ["{'x': 1, \"y\": -5e-1, z: +2}"],
        [" {x: 1,y: -0.5 , z: 2,} "],
        ["{x:1,y:-.5,z:2}"],
        ["x: 1\ny: -0.5\nz: 2\n"],
        ["geometry_msgs/Vector3", "  x: 1.0\n\n  y: -.5\n  z: 2"],
        ["geometry_msgs/Vector3", "{x: 1, y: -0.5, z: 2}"],
        ["geometry_msgs/msg/Point", "1", "-.5", "2"],
        ["Waypoint", "x=1", "y=-0.5", "z=2"],
        ["quadctl/Waypoint", "1", "-0.5", "2"],
    ],
)
def test_a_waypoint_is_read_in_many_spellings(words: list[str]):
    assert message_of(Waypoint, "input/position_request", words) == Waypoint(1.0, -0.5, 2.0)


@pytest.mark.parametrize(
    "words",
    [
        SETPOINT.split(),
        ["{boot: b, for_seq: 1, position: {x: 1, y: 2, z: 3}, brake: False}"],
        ["boot: 'b'\nfor_seq: 1\nposition: {x: 1, y: 2, z: 3}\nbrake: False"],
        ["boot: b\nfor_seq: 1\nposition:\n  x: 1\n  y: 2\n  z: 3\nbrake: false"],
        ["b", "1", "{x = 1, y = 2, z = 3}", "False"],
    ],
)
def test_a_message_with_a_nested_table_is_read(words: list[str]):
    found = message_of(Setpoint, "input/position", words)
    assert (found.boot, found.for_seq, found.brake) == ("b", 1, False)
    assert (found.position.x, found.position.y, found.position.z) == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["x=1", "y=2"], "missing required field `z`"),
        (["1", "2", "3", "4"], "takes 3 values"),
        (["x=1", "y=2", "z=inf"], "$.z"),
        (["x=1", "y=2", "z=10001"], "$.z"),
        (["x=1", "y=2", "z=three"], "$.z"),
        (["x=1", "y=2", "z=3", "w=4"], "unknown field `w`"),
        (["{x: 1, y: 2"], "expected ',' or '}', but got '<stream end>', line 1, column 12"),
        (["{x: 1 y: 2}"], "expected ',' or '}', but got ':', line 1, column 8"),
        (["{x: 1, y: 2, z: 3} 4"], "but found '<scalar>', line 1, column 20"),
        (["{x: ,}"], "got `null` - at `$.x`"),
        (["{x:'1, 2', y: 2}"], "has no blank after its colon, line 1, column 2"),
        (["{x: &a 1, y: *a, z: *a}"], "aliases and tags are not accepted, line 1, column 5"),
        (["x: !!float 1\ny: 2\nz: 3"], "aliases and tags are not accepted, line 1, column 4"),
        (['{x: "\\ud800"}'], "half a character, line 1, column 5"),
        (['{"\\ud800": 1}'], "half a character, line 1, column 2"),
        (["{[x]: 1}"], "a name must be a word or a quoted text, line 1, column 2"),
        (["x: 1\ny: \x07"], "special characters are not allowed, at 9"),
        (["{x: 1}\n---\n{y: 2}"], "more than one document, line 2, column 1"),
        (["{x: 'it}"], "found unexpected end of stream, line 1, column 9"),
        (["x: 1\n y: 2"], "mapping values are not allowed here, line 2, column 3"),
        (["x: {y: 1"], "expected ',' or '}'"),
        (["x: here: there"], "got `str` - at `$.x`"),
        (["x: 1\ny: here: there"], "mapping values are not allowed here, line 2, column 8"),
        (["x: 1\ny:\nz: 2"], "$.y"),
        (["x:\n" + "- " * 100_000], "nested deeper"),
        (["{" * 100_000], "a name must be a word"),
        (["x: " + "[" * 100_000], "nested deeper"),
        (["[" * 100_000], ""),
    ],
)
def test_an_invalid_waypoint_is_rejected_with_the_reason(words: list[str], named: str):
    with pytest.raises(Invalid) as caught:
        message_of(Waypoint, "input/position_request", words)
    assert named in caught.value.message
    assert caught.value.hint


SCALARS = (
    st.none() | st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False)
    | st.text("ab c{}[]:,'\\\"é", max_size=6)
)  # fmt: skip
DATA = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("abc", min_size=1), inner), max_leaves=8
)  # fmt: skip


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("zero: true", {"zero": True}),
        ("data: hello: there, you", {"data": "hello: there, you"}),
        ("data: 'hello: there, you'", {"data": "hello: there, you"}),
        ("data: - 1", {"data": "- 1"}),
        ("name: @home\n", {"name": "@home"}),
        ("data: http://there:80, you", {"data": "http://there:80, you"}),
        ("data: |\n  hello: there,\n  you", {"data": "hello: there,\nyou"}),
        ("data: ''", {"data": ""}),
        ("{a:{b:1,c:[2]},url:http://there:80/x, d:}", {"a": {"b": 1, "c": [2]}, "url": "http://there:80/x", "d": None}),
        ("a:\n  b:\n    c: 1\n  d: [1, {e: 2}]\nf: ~", {"a": {"b": {"c": 1}, "d": [1, {"e": 2}]}, "f": None}),
        ("data:\n- 0\n- 1", {"data": [0, 1]}),
        ("a:\n  - x: 1\n    y: 2\n  - - 3\n  -\nb: 4", {"a": [{"x": 1, "y": 2}, [3], None], "b": 4}),
    ],
)  # fmt: skip
def test_the_yaml_lines_of_ros_completion_are_a_table(text: str, found: Any):
    assert table_of([text]) == found


@pytest.mark.parametrize("text", ["http://host", "12:30", "error: it\nis no table", "a b: c", ""])
def test_a_text_with_a_colon_is_not_a_table(text: str):
    assert table_of([text]) == text


@given(DATA)
def test_the_flow_style_reads_all_json(value: Any):
    assert values._yaml(json.dumps(value, ensure_ascii=False)) == value


@pytest.mark.parametrize(
    "word",
    [
        "on", "off", "yes", "No", "y", "true", "False", "null.", "1e3", "1E-3", "+2", ".5", "2.", "010",
        "0x1f", "0o17", "1_000", "1:30", "190:20:30", "2026-11-21", "inf", "nan", ".inf", "1.2.3", "=",
        "a-b", "a#b", "NULL", "None",
    ],
)  # fmt: skip
def test_a_bare_word_means_the_same_in_yaml(word: str):
    found = repr(table_of([f"data={word}"]))
    assert repr(table_of([f"{{data: {word}}}"])) == found
    assert repr(table_of([f"data: {word}"])) == found


@pytest.mark.parametrize("word", ["", "~", "null"])
def test_an_empty_value_is_null(word: str):
    assert table_of([f"data: {word}"]) == table_of([f"{{data: {word}}}"]) == {"data": None}


@pytest.mark.parametrize("word", ["on", "1e3", "~", "null", "1", "true"])
def test_a_quoted_word_is_a_text(word: str):
    assert table_of([f"{{a: '{word}', {word}: \"{word}\"}}"]) == {"a": word, word: word}


@given(st.text("{}[]:,'\"ab1 .-\\\n", max_size=20))
def test_any_text_is_either_read_or_invalid(text: str):
    for begin in ("{", "a: ", "a:\n"):
        with suppress(Invalid):
            table_of([begin + text])


@pytest.mark.parametrize(
    ("words", "kept"),
    [
        (["std_msgs/String", "hello"], ["hello"]),
        (["std_srvs/srv/SetBool", "data=true"], ["data=true"]),
        (["my_own/srv/Square", "a=1"], ["a=1"]),
        (["std_msgs/String"], ["std_msgs/String"]),
        (["hello", "world"], ["hello", "world"]),
        (["a/b", "c"], ["a/b", "c"]),
        (["a/", "c"], ["a/", "c"]),
    ],
)
def test_a_type_before_the_message_is_ignored(words: list[str], kept: list[str]):
    assert without_type(words) == kept


def test_a_known_topic_is_sent_with_its_type():
    sent = payload_of(REQUEST, "uav", ["1", "2", "3"], "")
    assert sent.encoding == codec.encoding(Waypoint)
    assert codec.decode(Waypoint, *sent) == Waypoint(1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("line", "form", "sent"),
    [
        ("hello", "", Payload(b"hello", "text/plain")),
        ("3", "", Payload(b"3", "text/plain")),
        ("a=1 b.c=x", "", Payload(b'{"a":1,"b":{"c":"x"}}', "application/json")),
        ('{"a":[1,null]}', "", Payload(b'{"a":[1,null]}', "application/json")),
        ("1 two", "", Payload(b'[1,"two"]', "application/json")),
        ("a=1", "msgpack", Payload(b"\x81\xa1a\x01", "application/msgpack")),
        ("7", "msgpack", Payload(b"\x07", "application/msgpack")),
        ("hello there", "text", Payload(b"hello there", "text/plain")),
        ("a=1", "text", Payload(b"a=1", "text/plain")),
        ("00ff 10", "hex", Payload(b"\x00\xff\x10", "zenoh/bytes")),
        ("std_msgs/Bool True", "json", Payload(b"true", "application/json")),
    ],
)
def test_any_other_key_is_sent_in_the_given_form(line: str, form: str, sent: Payload):
    for key in ("camera/image", "other/input/position_request"):
        assert payload_of(key, "uav", line.split(), form) == sent


@pytest.mark.parametrize(
    ("key", "words", "form", "error"),
    [
        (REQUEST, ["1", "2", "3"], "json", Invalid),
        ("a/b", ["xyz"], "hex", Invalid),
        ("a/b", [f"{2**70}", "1"], "msgpack", Invalid),
        ("a/b", [], "", UsageError),
        ("a/b", ["1"], "xml", UsageError),
    ],
)
def test_an_unencodable_message_is_rejected(
    key: str, words: list[str], form: str, error: type[Exception]
):
    with pytest.raises(error):
        payload_of(key, "uav", words, form)
