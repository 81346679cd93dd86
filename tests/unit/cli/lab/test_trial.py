"""Trials of a rubric without flights: the mutants that are tried, and the report on them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from quadctl.cli.lab import grading, trial
from quadctl.cli.lab.handin import HandIn
from quadctl.cli.lab.judge import RowResult
from quadctl.cli.lab.machine import Machine
from quadctl.cli.lab.rubric import Rubric
from quadctl.services.runtime.errors import Invalid
from tests.support.archives import folder

SAFETY = b"""
from geometry import inside

def on_goto(goal):
    if goal.z < 0:  # equivalent never: nobody asks
        return False
    return inside(goal)
"""
FILES = {
    "quad.toml": b'[processes]\nsafety = "python my_safety.py"\npressure = "python air.py"\n',
    "my_safety.py": SAFETY,
    "geometry.py": b"def inside(p):\n    return abs(p.x) <= 3\n",
    "air.py": b"import geometry\n\ndef read():\n    return -geometry.height\n",
    "test_lab.py": b"def test():\n    assert -1 < 0\n",
}
ARRIVES = {
    "name": "flies",
    "expect": "arrives",
    "rows": [{"at": 4.0, "do": "goto", "x": 1.0, "y": 1.0, "z": 1.0}],
}
ANSWERS = {
    "name": "calibrates", "expect": "answers", "service": "calibrate_pressure",
    "rows": [{"at": 4.0, "do": "calibrate"}],
}  # fmt: skip
BOTH = {"row": [ARRIVES, ANSWERS]}


@pytest.fixture
def solution(tmp_path: Path) -> HandIn:
    return HandIn("good", folder(tmp_path / "good", FILES))


def planned(solution: HandIn, tables: dict[str, Any] = BOTH, only: str = "") -> list[trial.Tried]:
    with trial.right_solutions([solution]) as right:
        return trial.plan(right, tables, only)


def test_sources_of_nodes_and_what_they_import_have_mutants(solution: HandIn):
    assert {(each.file, each.nodes) for each in planned(solution)} == {
        ("my_safety.py", frozenset({"safety"})),
        ("geometry.py", frozenset({"safety", "pressure"})),
        ("air.py", frozenset({"pressure"})),
    }


def test_a_node_without_rows_has_no_mutants(solution: HandIn):
    found = planned(solution, {"row": [ARRIVES]})
    assert {each.file for each in found} == {"my_safety.py", "geometry.py"}


def test_only_chooses_an_operator_or_a_text(solution: HandIn):
    assert {each.mutant.operator for each in planned(solution, only="compare")} == {"compare"}
    assert {each.file for each in planned(solution, only="geometry.py")} == {"geometry.py"}
    with pytest.raises(Invalid) as refused:
        planned(solution, only="twise")
    assert "twise" in refused.value.message
    assert "twice" in refused.value.hint


@pytest.mark.parametrize(
    ("files", "error"),
    [
        ({"quad.toml": b'[processes]\nsafety = "cat"\n'}, "run no file in Python"),
        ({"my_safety.py": b"def f(:"}, "my_safety.py: invalid syntax"),
        ({"quad.toml": b""}, "names no node under [processes]"),
    ],
)
def test_a_solution_without_a_source_is_refused(
    tmp_path: Path, files: dict[str, bytes], error: str
):
    with pytest.raises(Invalid) as refused:
        planned(HandIn("bad", folder(tmp_path / "bad", FILES | files)))
    assert refused.value.message.startswith("bad: ")
    assert error in refused.value.message


def test_a_rubric_without_a_row_about_a_solution_is_refused(tmp_path: Path):
    files = {name: FILES[name] for name in ("my_safety.py", "geometry.py")}
    with pytest.raises(Invalid) as refused:
        planned(HandIn("half", folder(tmp_path / "half", files)), {"row": [ANSWERS]})
    assert refused.value.message == "half has safety, and the rubric no row about it"


def tried(
    solution: HandIn, monkeypatch: pytest.MonkeyPatch, holds: Callable[[str], bool]
) -> tuple[trial.Trial, list[str]]:
    """Try the rubric with a judge for whom a row holds if the text of all sources does."""

    def flown(job: grading.GradingJob, made: Rubric, *_: object) -> list[RowResult]:
        text = "".join(
            Path(job.folder, name).read_text("utf-8") for name in FILES if name.endswith(".py")
        )
        # As if the last row were flown first.
        outputs = [*["safety crashed: x"] * len(made.rows)]
        if job.first_loss:
            outputs[:-1] = [grading.AFTER_LOSS] * (len(made.rows) - 1)
        ok = holds(text)
        return [
            RowResult(row.name, row.number, ok, float(ok), 1, output, True)
            for row, output in zip(made.rows, outputs, strict=True)
        ]

    monkeypatch.setattr(grading, "_flown", flown)
    notes: list[str] = []
    with trial.right_solutions([solution]) as right:
        found = trial.plan(right, BOTH, "")
        flights = trial.Flights(BOTH, Machine(), 2)
        return trial.fly(right, found, flights, notes.append), notes


def test_mutants_that_pass_are_named_with_their_fault(
    solution: HandIn, monkeypatch: pytest.MonkeyPatch
):
    right = "".join(FILES[name].decode() for name in FILES if name.endswith(".py"))
    weak = right.replace("<= 3", "< 3")
    done, notes = tried(solution, monkeypatch, lambda text: text in {right, weak})
    assert not done.ok
    passed = "good geometry.py:2 compare: return abs(p.x) <= 3 -> return abs(p.x) < 3"
    assert [each.name for each in done.tried if each.outcome == "passed"] == [passed]
    text = done.text().splitlines()
    assert text[0] == "good: full marks"
    assert text[text.index("these pass:") + 1] == f"  {passed}"
    assert f"passes: {passed}" in notes
    assert "nobody asks" in done.text()
    document = done.document()
    assert document["operators"]["compare"] == {"crashed": 1, "passed": 1}
    assert document["operators"]["never"] == {"equivalent": 1}
    (goal,) = [
        each for each in document["mutants"] if "sign" in each["name"] and "air" in each["name"]
    ]
    assert (goal["row"], goal["outcome"]) == ("2 calibrates", "crashed")
    assert document["solutions"] == [{"name": "good", "ok": True, "problem": "", "lost": []}]


def test_a_right_solution_that_loses_is_reported_and_its_mutants_do_not_fly(
    solution: HandIn, monkeypatch: pytest.MonkeyPatch
):
    done, notes = tried(solution, monkeypatch, lambda text: False)
    assert (done.ok, done.tried) == (False, [])
    lines = [
        "good: right, but it loses rows; its mutants were not flown",
        "  1 flies: safety crashed: x",
        "  2 calibrates: safety crashed: x",
    ]
    assert done.text().splitlines()[:3] == lines
    assert notes == ["\n".join(lines)]


def test_a_solution_shares_nothing_with_its_mutants(
    solution: HandIn, monkeypatch: pytest.MonkeyPatch
):
    done, _ = tried(solution, monkeypatch, lambda text: True)
    assert (solution.path / "my_safety.py").read_bytes() == SAFETY
    assert {each.outcome for each in done.tried} == {"passed", "equivalent"}
    assert done.document()["idle_rows"] == ["1 flies", "2 calibrates"]
