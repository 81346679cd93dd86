"""Mutants: each has one fault, of a kind that students make, and a name of its own."""

import ast
import difflib
from functools import cache

import pytest

from quadctl.cli.lab.mutants import OPERATORS, Mutant, mutants
from quadctl.services.runtime.errors import Invalid
from tests.support.handins import SOLUTIONS

MOST_EQUIVALENT = 0.1


@cache
def ours() -> list[tuple[str, list[Mutant]]]:
    """Return each source of our solutions, and its mutants."""
    return [
        (text, mutants(text, f"{file.parent.name}/{file.name}"))
        for file in sorted(SOLUTIONS.rglob("*.py.txt"))
        for text in [file.read_text("utf-8")]
    ]


def faults(body: str, operator: str) -> list[str]:
    """Return the faults of an operator in the body of a method, or of a class after its methods."""
    lines = "\n".join(f"        {line}" for line in body.splitlines())
    return [
        f"{each.old} -> {each.new}"
        for each in mutants(f"class Node:\n    def on_pose(self, pose):\n{lines}\n", "a.py")
        if each.operator == operator
    ]


@pytest.mark.parametrize(
    ("operator", "body", "expected"),
    [
        ("compare", "ok = p.x <= 3", ["ok = p.x <= 3 -> ok = p.x < 3"]),
        ("compare", "ok = a and b", ["ok = a and b -> ok = a or b"]),
        (
            "compare",
            "ok = (low\n      <= z  # from here\n      < high)",
            ["ok = (low <= z < high) -> ok = (low < z < high)",
             "ok = (low <= z < high) -> ok = (low <= z <= high)"],
        ),
        ("compare", "ok = self.state is not None", ["ok = self.state is not None -> ok = self.state is None"]),
        ("compare", "near = d < self.reach", ["near = d < self.reach -> near = d > self.reach"]),
        ("bound", "ok = p.z < 0", ["ok = p.z < 0 -> ok = p.z < 0 + 0.3", "ok = p.z < 0 -> ok = p.z < 0 - 0.3"]),
        (
            "bound",
            "ok = -c.x <= p.x <= c.x",
            ["ok = -c.x <= p.x <= c.x -> ok = -c.x + 0.3 <= p.x <= c.x",
             "ok = -c.x <= p.x <= c.x -> ok = -c.x - 0.3 <= p.x <= c.x",
             "ok = -c.x <= p.x <= c.x -> ok = -c.x <= p.x <= c.x + 0.3",
             "ok = -c.x <= p.x <= c.x -> ok = -c.x <= p.x <= c.x - 0.3"],
        ),
        ("bound", "self.home = Position(0, a, b)", ["self.home = Position(0, a, b) -> self.home = Position(1.0, a, b)"]),
        ("bound", "self.base = 0.0", ["self.base = 0.0 -> self.base = 1.0"]),
        ("bound", "last = last[-10:]", ["last = last[-10:] -> last = last[-(10 * 10):]"]),
        ("bound", "self.n = Pressure(t, p, b, 0, 0.0)", []),
        ("axis", "z = p.z", ["z = p.z -> z = p.x"]),
        ("axis", 'd = f("xyz")', ["d = f(\"xyz\") -> d = f('xyx')"]),
        ("axis", 'self.why = f"at {p.z}"', []),
        ("sign", "d = (a - b) ** 2", ["d = (a - b) ** 2 -> d = (a + b) ** 2"]),
        ("sign", "ok = abs(p.x) <= 3", ["ok = abs(p.x) <= 3 -> ok = p.x <= 3"]),
        ("sign", "d = abs(a + b) * c", ["d = abs(a + b) * c -> d = (a + b) * c", "d = abs(a + b) * c -> d = abs(a - b) * c"]),
        ("sign", "ok = a or not b", ["ok = a or not b -> ok = a or b"]),
        ("sign", "return GotoResponse(False, why)", ["return GotoResponse(False, why) -> return GotoResponse(True, why)"]),
        ("sign", "return ToggleCageResponse(success=True)", ["return ToggleCageResponse(success=True) -> return ToggleCageResponse(success=False)"]),
        ("sign", "raw = p + uniform(-1e-5, 1e-5)", []),
        ("sign", "work(daemon=True)", []),
        ("order", "self.state = 1\nself.states.put(self.state)", ["self.state = 1 -> below self.states.put(self.state)"]),
        ("order", "self.a = 1\nself.b = 2", []),
        ("missing transition", "self.state = 1", ["self.state = 1 -> pass"]),
        ("missing transition", "self.a, b = c, d", ["self.a, b = c, d -> self.a, b = self.a, d"]),
        ("missing transition", "self.last.append(raw)", ["self.last.append(raw) -> pass"]),
        ("missing transition", "goal = 1", []),
        ("missing publish", "self.out.put(a)", ["self.out.put(a) -> pass"]),
        ("wrong unit", "return CalibrateResponse(self.base)", ["return CalibrateResponse(self.base) -> return CalibrateResponse(100 * self.base)"]),
        ("wrong unit", "return Pressure(stamp=t, pressure=a - b, samples=n)", [
            "return Pressure(stamp=t, pressure=a - b, samples=n) -> return Pressure(stamp=100 * t, pressure=a - b, samples=n)",
            "return Pressure(stamp=t, pressure=a - b, samples=n) -> return Pressure(stamp=t, pressure=100 * (a - b), samples=n)",
        ]),
        ("wrong unit", "raw = 1013.25 - h", ["raw = 1013.25 - h -> raw = 100 * 1013.25 - h"]),
        ("early", "near = d < self.reach", [
            "near = d < self.reach -> near = d < 2 * self.reach", "near = d < self.reach -> near = True",
        ]),
        ("late", "near = d < self.reach", ["near = d < self.reach -> near = d < 0.5 * self.reach"]),
        ("late", "self.on = a\nb = self.on\nself.c = b\nreturn b", ["self.on = a -> below self.c = b"]),
        ("twice", "self.n += 1", ["self.n += 1 -> twice"]),
        ("twice", "self.out.append(\n    a\n)", ["self.out.append( a ) -> twice"]),
        ("twice", "self.out.put(a)", []),
        ("twice", "a = b - c", ["a = b - c -> a = b - c - c"]),
        ("never", "if a:\n    b()", ["a -> False"]),
        ("never", "a = b if c else d", ["a = b if c else d -> a = d"]),
    ],
)  # fmt: skip
def test_each_operator_makes_its_faults(operator: str, body: str, expected: list[str]):
    assert faults(body, operator) == expected


def test_each_operator_has_an_example_above():
    (marker,) = test_each_operator_makes_its_faults.pytestmark
    assert {operator for operator, *_ in marker.args[1]} == {*OPERATORS}


def test_a_call_changes_and_publishes_what_its_function_does():
    source = """
class Node:
    def __init__(self):
        self.enter(1)

    def enter(self, state):
        self.state = state
        self.publish()

    def publish(self):
        self.states.put(self.state)

    def on_pose(self, pose):
        self.enter(2)
        self.publish()
"""
    found = [each for each in mutants(source, "a.py") if each.line > 12]
    assert {(each.operator, each.old) for each in found} == {
        ("missing transition", "self.enter(2)"),
        ("missing publish", "self.publish()"),
        ("order", "self.enter(2)"),
    }


def test_names_that_a_loop_keeps_are_state():
    source = """
def run(node):
    boot, out = "", node.publisher(STATE)
    for pose in node.poses():
        if pose.boot != boot:
            boot = pose.boot
        there = pose.position
        out.put(there)
"""
    found = {each.old for each in mutants(source, "a.py") if each.operator == "missing transition"}
    assert found == {"boot = pose.boot"}


def test_every_mutant_of_ours_is_python_and_differs_in_one_place():
    names = []
    for source, mutant in [(text, each) for text, found in ours() for each in found]:
        ast.parse(mutant.source)
        names.append(mutant.name)
        matcher = difflib.SequenceMatcher(
            None, source.splitlines(), mutant.source.splitlines(), autojunk=False
        )
        places = [each for each in matcher.get_opcodes() if each[0] != "equal"]
        moved = mutant.operator in {"order", "late"}
        assert len(places) == 1 or moved, mutant.name
        assert places[0][1] + 1 >= mutant.line or moved, mutant.name
        if "\n" not in mutant.old and not moved and mutant.new != "pass":
            assert len(mutant.source.splitlines()) >= len(source.splitlines())
    assert len(set(names)) == len(names)


def test_ours_have_many_mutants_by_each_operator_and_few_are_equivalent():
    found = [mutant for _, some in ours() for mutant in some]
    assert len(found) >= 150
    assert {mutant.operator for mutant in found} == {*OPERATORS}
    assert sum(bool(mutant.equivalent) for mutant in found) <= MOST_EQUIVALENT * len(found)


def test_each_comment_on_equivalence_of_ours_is_about_a_mutant():
    for source, found in ours():
        excused = {(each.line, each.operator) for each in found if each.equivalent}
        assert len(excused) == source.count("# equivalent ")


EXCUSED = """
def f(self):
    self.n += 1  # equivalent twice: it only has to differ
    # equivalent compare: nobody asks
    # equivalent bound: as above
    self.ok = 1 < 2
    self.n += 1
"""


def test_a_comment_lists_the_mutants_by_its_operator_on_its_line():
    found = {each.name: each.equivalent for each in mutants(EXCUSED, "a.py") if each.equivalent}
    assert found == {
        "a.py:3 twice: self.n += 1 -> twice": "it only has to differ",
        "a.py:6 compare: self.ok = 1 < 2 -> self.ok = 1 <= 2": "nobody asks",
        "a.py:6 bound: self.ok = 1 < 2 -> self.ok = 1 < 2 + 0.3": "as above",
        "a.py:6 bound: self.ok = 1 < 2 -> self.ok = 1 < 2 - 0.3": "as above",
    }


@pytest.mark.parametrize(
    ("source", "error", "hint"),
    [
        ("def f(:", "a.py: invalid syntax", "a node that runs"),
        ("a = 1  # equivalent twise: so", "a.py:1: there is no operator twise", "twice"),
        ("a = 1  # equivalent so: so", "a.py:1: there is no operator so", "compare, bound, axis"),
    ],
)
def test_what_cannot_be_read_is_refused(source: str, error: str, hint: str):
    with pytest.raises(Invalid) as refused:
        mutants(source, "a.py")
    assert error in refused.value.message
    assert hint in refused.value.hint
