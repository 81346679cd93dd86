"""`lab rubric check`, as a teacher uses it: right solutions and their mutants are really flown."""

import pytest

from quadctl.cli.lab.mutants import OPERATORS
from tests.support.handins import write
from tests.support.lab import Lab
from tests.support.proofs import Proofs

LOW = """
[[row]]
name = "flies to the top wall"
expect = "arrives"
end = 8.0
set = { safety.virtual_cage.z = 1.5 }
rows = [{ at = 4.0, do = "goto", x = 1.0, y = 1.0, z = 1.5 }]
"""
"""Rubric that asks for one wall only."""


def test_a_mutant_that_no_row_is_about_passes_and_is_named(lab: Lab):
    rubric, good = lab.file(LOW, "rubric.toml"), write("completed", lab.folder)
    done = lab.quadctl(
        "lab", "rubric", "check", rubric, good, "--only", "< cage.", "--trust", "--json",
        timeout=120.0,
    )  # fmt: skip
    assert done.code == 8, done.err
    assert done.json["solutions"] == [{"name": str(good), "ok": True, "problem": "", "lost": []}]
    outcomes = {each["new"].partition(" <")[0]: each for each in done.json["mutants"]}
    assert {name: each["outcome"] for name, each in outcomes.items()} == {
        "abs(point.x)": "passed", "abs(point.y)": "passed", "point.z": "lost",
    }  # fmt: skip
    lost = outcomes["point.z"]
    assert lost["row"] == "1 flies to the top wall"
    assert lost["output"] == "goto 1 1 1.5: refused, outside the cage"
    assert f"passes: {outcomes['abs(point.x)']['name']}" in done.err
    assert "3 of 3 mutants flown, 2 pass" in done.err


@pytest.mark.thorough
def test_a_wrong_solution_is_reported_and_its_mutants_do_not_fly(lab: Lab):
    rubric, bad = lab.file(LOW, "rubric.toml"), write("never_arrives", lab.folder)
    done = lab.quadctl("lab", "rubric", "check", rubric, bad, "--trust", timeout=120.0)
    assert done.code == 8, done.err
    first, second, *_ = done.out.splitlines()
    assert first == f"{bad}: right, but it loses rows; its mutants were not flown"
    assert second.startswith("  1 flies to the top wall: goto 1 1 1.5: ")
    assert "\n0 mutants: 0 lose a row" in done.out


@pytest.mark.parametrize(
    ("words", "code", "error"),
    [
        ("nothere.toml", 6, "nothere.toml"),
        ("rubric.toml nothere", 6, "there is no solution nothere"),
        ("rubric.toml .", 6, "names no node under [processes]"),
        ("rubric.toml --only twise", 6, "--only twise: it is in the name of none of"),
        ("rubric.toml --jobs 0", 2, "jobs"),
    ],
)
def test_a_wrong_call_is_refused(lab: Lab, words: str, code: int, error: str):
    lab.file(LOW, "rubric.toml")
    lab.file("", "quad.toml")
    done = lab.quadctl("lab", "rubric", "check", *words.split())
    assert (done.code, done.out) == (code, "")
    assert error in done.err


@pytest.mark.prove
@pytest.mark.timeout(7200)
def test_each_mutant_of_our_solutions_loses_a_row(lab: Lab, proofs: Proofs):
    done = lab.quadctl("lab", "rubric", "check", "--trust", "--json", timeout=7000.0)
    assert all(each["ok"] for each in done.json["solutions"]), done.json["solutions"]
    found = done.json["mutants"]
    outcomes = [each["outcome"] for each in found]
    wrong = [each["name"] for each in found if each["outcome"] in {"passed", "not judged"}]
    assert (done.code, wrong) == (0, [])
    assert done.json["operators"].keys() == {*OPERATORS}
    flown = len(found) - outcomes.count("equivalent")
    assert flown >= 150
    assert outcomes.count("equivalent") <= 0.1 * len(found)
    proofs.add(
        "Mutants of right solutions that pass the lab's rubric",
        f"0 of {flown}, without {len(found) - flown} that are right as well",
        "0",
    )
