"""`param` and `node` without a run: the answers and the errors that need no bus."""

from pathlib import Path

import pytest

from quadctl.schemas.params import FIXED_AT_LAUNCH
from quadctl.services.runtime.params import catalogue
from tests.support.command_line import Quadctl

INVALID = {
    "param describe safety.takeof": (6, "did you mean safety.takeoff?"),
    "param describe nonsense": (6, "quadctl init"),
    "param describe": (2, ""),
    "param load none.toml": (6, "quadctl init"),
    "param load broken.toml": (6, "line"),
    "param load unknown.toml": (6, "did you mean safety.takeoff?"),
    "param save": (6, "quadctl init"),
    "param save broken.toml": (6, "line"),
    "param save unknown.toml": (6, "did you mean safety.takeoff?"),
    "param diff none.toml": (6, "quadctl init"),
    "node ping": (2, ""),
    "node ping safety --all": (2, ""),
    "node ping safety -n 0": (2, ""),
    "node ping safety --interval nan": (2, "seconds"),
    "node ping safety --interval -1": (2, "seconds"),
    "node kill safety --signal HUP": (2, "KILL, TERM"),
    "node logs safety -n -1": (2, ""),
}

FILES = {
    "broken.toml": "[safety\ntakeoff = 2.0\n",
    "unknown.toml": "[safety]\ntakeof = 2.0\n",
}


@pytest.mark.parametrize("line", INVALID)
def test_invalid_arguments_are_rejected_before_any_call(
    quadctl: Quadctl, tmp_path: Path, line: str
):
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    code, hint = INVALID[line]
    result = quadctl(*line.split(), "--json")
    assert (result.code, result.out) == (code, "")
    assert hint in result.error["hint"]
    assert {p.name: p.read_text(encoding="utf-8") for p in tmp_path.iterdir()} == FILES


def test_a_parameter_is_described_without_a_value(quadctl: Quadctl):
    result = quadctl("param", "describe", "/state_safety_node/virtual_cage/x", "--json")
    assert (result.code, result.err) == (0, "")
    assert result.json == [
        {
            "name": "safety.virtual_cage.x",
            "type": "float64",
            "unit": "m",
            "bounds": "[0.2, 10000]",
            "default": 5.0,
            "value": None,
            "node": "safety",
            "fixed_at_launch": False,
            "meaning": "x in [-x, x], y in [-y, y], z in [0, z]",
        }
    ]
    lines = quadctl("param", "describe", "dynamics.speed").out.splitlines()
    assert "Change:   at launch" in lines
    assert "Value:    -" in lines
    assert next(line for line in lines if line.startswith("Meaning:")).endswith("as possible")


def test_tables_are_described_leaf_by_leaf(quadctl: Quadctl):
    names = sorted({name.partition(".")[0] for name in catalogue.leaves()})
    result = quadctl("param", "describe", *names, "--json")
    assert {leaf["name"] for leaf in result.json} == set(catalogue.leaves())
    fixed = {leaf["name"] for leaf in result.json if leaf["fixed_at_launch"]}
    assert fixed == FIXED_AT_LAUNCH | {"supervise.answer_timeout", "processes"}
    as_text = quadctl("param", "describe", "safety", "safety.virtual_cage").out.splitlines()
    assert as_text[0] == "safety: The safety automaton"
    assert "" in as_text
    assert len([line for line in as_text if line.startswith("safety.virtual_cage.x ")]) == 2


def test_missing_named_hub_is_exit_3_even_for_describe(quadctl: Quadctl):
    line = "param describe safety.takeoff --connect unixsock-stream/none.sock"
    assert quadctl(*line.split()).code == 3


def test_the_logs_of_a_killed_run_can_be_read(quadctl: Quadctl, tmp_path: Path):
    logs = tmp_path / "quadctl" / "default" / "logs"
    logs.mkdir(parents=True)
    (logs / "safety.log.1").write_bytes(b"one\ntwo\n")
    (logs / "safety.log").write_bytes(b"three\nfo\xffr\nhalf a li")
    (logs / "up.log").write_bytes(b"safety ended\n")
    assert quadctl("node", "logs", "safety").out == "one\ntwo\nthree\nfo�r\n"
    assert quadctl("node", "logs", "/state_safety_node", "-n", 3, "-f").out == "two\nthree\nfo�r\n"
    both = "safety   | fo�r\nup       | safety ended\n"
    assert quadctl("node", "logs", "-n", 1).out == both
    assert quadctl("node", "logs", "-n", 0) == (0, "", "")
    as_json = quadctl("node", "logs", "up", "--json").json
    assert as_json == {"node": "up", "line": "safety ended"}
    result = quadctl("node", "logs", "saftey", "--json")
    assert (result.code, result.error["hint"]) == (3, "did you mean safety?")
