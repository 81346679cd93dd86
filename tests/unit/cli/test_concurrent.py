"""Several asked at the same time: who is late is told so, and holds up nobody's answer."""

import json
import threading

import pytest

from quadctl.cli import output
from quadctl.cli.concurrent import ask_each
from quadctl.services.runtime.errors import Refused


def test_each_answer_or_problem_comes_in_the_order_asked():
    def ask(name: str) -> str:
        if name == "b":
            raise Refused("no")
        return name.upper()

    heard = ask_each(["c", "b", "a"], ask)
    assert list(heard.answers.items()) == [("c", "C"), ("a", "A")]
    assert list(heard.problems) == ["b"]
    with pytest.raises(Refused):
        heard.fail()


@pytest.mark.parametrize("names", [["late"], ["quick", "late"]])
def test_who_is_late_is_not_waited_for(names: list[str]):
    enough = threading.Event()

    def ask(name: str) -> str:
        if name == "late":
            enough.wait(30)
        return name

    heard = ask_each(names, ask, within=0.1)
    assert list(heard.answers) == names[:-1]
    assert heard.problems["late"].code == "timeout"
    enough.set()


@pytest.mark.parametrize("as_json", [True, False])
def test_all_that_went_wrong_is_told_and_in_one_document(
    as_json: bool, capsys: pytest.CaptureFixture[str]
):
    def ask(name: str) -> str:
        raise Refused(f"{name} will not", f"ask {name} again")

    with pytest.raises(Refused) as raised:
        ask_each(["a", "b"], ask).fail()
    output.error(raised.value, as_json=as_json)
    said = capsys.readouterr().err
    if as_json:
        told = {"code": "refused", "message": "a will not; b will not", "hint": "ask a again"}
        assert json.loads(said) == {"error": told}
    else:
        assert said == "error: b will not\nerror: a will not\n  try: ask a again\n"


def test_where_all_are_needed_the_first_failure_ends_it():
    enough = threading.Event()

    def ask(name: str) -> str:
        if name == "late":
            enough.wait(30)
            return name
        raise Refused("no")

    heard = ask_each(["late", "away"], ask, 20, all_or_none=True)
    assert (heard.answers, list(heard.problems)) == ({}, ["away"])
    enough.set()


def test_what_nobody_foresaw_is_raised():
    def ask(name: str) -> int:
        return int(name)

    with pytest.raises(ValueError, match="invalid literal"):
        ask_each(["1", "x"], ask)
    assert ask_each(["1"], ask).answers == {"1": 1}
