"""rostopic's -1 or the number, and unknown options or words of a message."""

import pytest

from quadctl.cli.topic.pub import without_once
from tests.support.command_line import Quadctl

WAYPOINT = (3, "Waypoint")
UNKNOWN = (None, "")


@pytest.mark.parametrize(
    ("words", "rest", "of"),
    [
        (["std_msgs/String", "data: hello", "-1"], ["std_msgs/String", "data: hello"], UNKNOWN),
        (["-1", "std_msgs/String", "hello"], ["std_msgs/String", "hello"], UNKNOWN),
        (["hello", "-1"], ["hello"], UNKNOWN),
        (["a=1", "b=2", "-1"], ["a=1", "b=2"], UNKNOWN),
        (["{a: 1}", "-1"], ["{a: 1}"], UNKNOWN),
        (["-1", "{x: 1, y: 2, z: 1}"], ["{x: 1, y: 2, z: 1}"], WAYPOINT),
        (["1", "2", "-1", "-1"], ["1", "2", "-1"], WAYPOINT),
        (["quad/Waypoint", "1", "2", "1", "-1"], ["quad/Waypoint", "1", "2", "1"], WAYPOINT),
    ],
)
def test_minus_one_means_once_beside_a_whole_message(words: list[str], rest: list[str], of):
    assert without_once(words, *of) == (rest, True)


@pytest.mark.parametrize(
    ("line", "of"),
    [
        ("-1", UNKNOWN),
        ("1 -1", UNKNOWN),
        ("-1 2", UNKNOWN),
        ("std_msgs/Int32 -1", UNKNOWN),
        ("geometry_msgs/Vector3 1 2 -1", UNKNOWN),
        ("1 2 -1", WAYPOINT),
        ("-1 2 1", WAYPOINT),
        ("Waypoint 1 2 -1", WAYPOINT),
        ("Waypoint -1", WAYPOINT),
        ("hello world", UNKNOWN),
        ("", UNKNOWN),
    ],
)
def test_minus_one_among_numbers_is_a_number(line: str, of):
    assert without_once(line.split(), *of) == (line.split(), False)


@pytest.mark.parametrize(
    ("line", "option"),
    [
        ("topic pub --bogus --no-wait in/a x", "--bogus"),
        ("topic pub in/a x --bogus", "--bogus"),
        ("topic pub in/a x -t 2", "-t"),
        ("topic pub -1 --latch in/a x", "--latch"),
        ("service call goto 1 2 --bogus", "--bogus"),
        ("service call --bogus=1 goto", "--bogus"),
        ("goto 1 -2 --bogus", "--bogus"),
        ("goto 1 -2 1 -w", "-w"),
        ("record --bogus", "--bogus"),
    ],
)
def test_an_unknown_option_is_not_taken_as_part_of_a_message(
    quadctl: Quadctl, line: str, option: str
):
    result = quadctl(*line.split(), "--json")
    assert (result.code, result.out) == (2, "")
    assert result.error["message"].partition(" (")[0] == f"No such option: {option}"


@pytest.mark.parametrize("line", ["goto -1 -2.5 1e0", "topic pub a/b -1 -2", "topic pub a/b -- -x"])
def test_negative_numbers_and_words_after_two_dashes_are_not_options(quadctl: Quadctl, line: str):
    assert quadctl("--json", *line.split()).error["code"] == "unreachable"
