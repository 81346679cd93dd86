"""Files for a public forge: they parse, run our own commands, and say that they are untried."""

import re
import tomllib
from itertools import chain
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
MAKEFILE = (ROOT / "Makefile").read_text("utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def workflow(name: str) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load(
        (ROOT / ".github/workflows" / f"{name}.yml").read_text("utf-8")
    )
    return found


def commands(job: dict[str, Any]) -> list[str]:
    return [step["run"] for step in job["steps"] if "run" in step]


@pytest.mark.parametrize("file", WORKFLOWS, ids=lambda file: file.stem)
def test_a_workflow_runs_targets_of_make_and_says_that_it_is_untried(file: Path):
    head = file.read_text("utf-8").partition("name:")[0]
    assert "# Untried:" in head
    jobs = workflow(file.stem)["jobs"].values()
    made = re.findall(r"\bmake ([\w-]+)", "\n".join(chain.from_iterable(map(commands, jobs))))
    assert made
    for target in made:
        assert re.search(rf"^{target}:", MAKEFILE, re.MULTILINE), target


def test_the_tests_run_both_commands_of_the_readme_on_every_python():
    readme = re.findall(r"^\$ (make \w+)", (ROOT / "README.md").read_text("utf-8"), re.MULTILINE)
    assert len(readme) == 2
    jobs = workflow("tests")["jobs"]
    for job in jobs.values():
        ran = [command for command in commands(job) if command.startswith("make")]
        assert ran[:2] == readme
    pythons = re.findall(r"(?<=Python :: )3\.\d+", " ".join(PROJECT["classifiers"]))
    assert jobs["linux"]["strategy"]["matrix"]["python"] == pythons
    assert {job["runs-on"] for job in jobs.values()} == {"ubuntu-latest", "macos-latest"}


def test_a_release_is_published_only_as_make_release_built_it():
    jobs = workflow("release")["jobs"]
    assert commands(jobs["build"]) == ["make release TAGGED=1"]
    assert jobs["publish"]["needs"] == "build"
    # No password: the registry trusts the workflow by its token, which the build never has.
    assert jobs["publish"]["permissions"] == {"id-token": "write"}
    assert workflow("release")["permissions"] == {"contents": "read"}
    assert commands(jobs["publish"]) == []


@pytest.mark.parametrize("name", ["bug", "idea"])
def test_a_form_asks_for_what_it_needs(name: str):
    form = yaml.safe_load((ROOT / f".github/ISSUE_TEMPLATE/{name}.yml").read_text("utf-8"))
    asked = [field for field in form["body"] if field["type"] != "markdown"]
    assert len({field["id"] for field in asked}) == len(asked)
    assert any(field.get("validations", {}).get("required") for field in asked)


def test_the_citation_is_of_this_project():
    found = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    for field in ("authors", "version", "license", "keywords"):
        assert found[field] == PROJECT[field]
    assert found["abstract"] == PROJECT["description"]
