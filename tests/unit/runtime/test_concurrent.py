"""Concurrent calls: a late answer is left out and delays no other."""

import json
import threading

import pytest

from quadctl.cli import output
from quadctl.services.runtime.concurrent import ask_each
from quadctl.services.runtime.errors import Refused


def test_answers_and_problems_keep_the_order_of_the_calls():
    def ask(name: str) -> str:
        if name == "b":
            raise Refused("no")
        return name.upper()

    result = ask_each(["c", "b", "a"], ask)
    assert list(result.answers.items()) == [("c", "C"), ("a", "A")]
    assert list(result.problems) == ["b"]
    with pytest.raises(Refused):
        result.fail()


@pytest.mark.parametrize("names", [["late"], ["quick", "late"]])
def test_a_late_answer_is_left_out_without_delaying_the_others(names: list[str]):
    enough = threading.Event()

    def ask(name: str) -> str:
        if name == "late":
            enough.wait(30)
        return name

    result = ask_each(names, ask, within=0.1)
    assert list(result.answers) == names[:-1]
    assert result.problems == {}
    enough.set()


@pytest.mark.parametrize("as_json", [True, False])
def test_all_errors_are_reported_in_one_document(as_json: bool, capsys: pytest.CaptureFixture[str]):
    def ask(name: str) -> str:
        raise Refused(f"{name} will not", f"ask {name} again")

    with pytest.raises(Refused) as raised:
        ask_each(["a", "b"], ask).fail()
    output.error(raised.value, as_json=as_json)
    printed = capsys.readouterr().err
    if as_json:
        error = {"code": "refused", "message": "a will not; b will not", "hint": "ask a again"}
        assert json.loads(printed) == {"error": error}
    else:
        assert printed == "error: b will not\nerror: a will not\n  try: ask a again\n"


def test_if_all_answers_are_needed_the_first_failure_ends_the_wait():
    enough = threading.Event()

    def ask(name: str) -> str:
        if name == "late":
            enough.wait(30)
            return name
        raise Refused("no")

    result = ask_each(["late", "away"], ask, 20, all_or_none=True)
    assert (result.answers, list(result.problems)) == ({}, ["away"])
    enough.set()


def test_an_unexpected_exception_is_raised():
    ask = {"known": 1}.__getitem__
    with pytest.raises(KeyError):
        ask_each(["known", "unknown"], ask)
    assert ask_each(["known"], ask).answers == {"known": 1}
