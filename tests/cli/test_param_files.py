"""`param dump`, `load`, `diff` and `save`: from the running system to files and back."""

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from quadctl.services.runtime.params.catalogue import lab_params
from quadctl.services.runtime.params.load import load
from quadctl.services.runtime.params.names import flatten
from tests.support.bare import Bare, pack
from tests.support.lab import Lab, private_lab

OFFER = "uav/@node/{0}/@srv/GetParams/00000000/0/uav%@srv%{0}%get_params"


@pytest.fixture(scope="module")
def started() -> Iterator[Lab]:
    with private_lab() as made:
        assert made.quadctl("init").code == 0
        made.start("--set", "supervise.answer_timeout=3", "--set", "dynamics.seed=7")
        yield made


@pytest.fixture
def tuned(started: Lab) -> Iterator[Lab]:
    """`started` with the parameters of the launch, and with the file as `init` writes it."""
    (started.folder / "quad.toml").unlink()
    assert started.quadctl("init").code == 0
    yield started
    done = started.quadctl("param", "load", started.file(LAUNCH))
    assert (done.code, done.err) == (0, "")


LAUNCH = """
[pressure]
rate = 10.0
[safety]
takeoff = 1.0
virtual_cage = { x = 5.0, y = 5.0, z = 2.0 }
"""


def parameters(lab: Lab) -> Any:
    done = lab.quadctl("param", "dump", "--json")
    assert (done.code, done.err) == (0, "")
    return done.json


@pytest.mark.thorough
def test_a_dump_is_a_file_that_can_be_launched_and_loaded(tuned: Lab):
    assert tuned.quadctl("param", "set", "safety.takeoff", 2).code == 0
    done = tuned.quadctl("param", "dump", "-o", "dump.toml")
    assert done == (0, "wrote dump.toml\n", "")
    wanted = lab_params()
    wanted.safety.takeoff, wanted.dynamics.seed, wanted.supervise.answer_timeout = 2.0, 7, 3.0
    assert load(tuned.folder / "dump.toml") == wanted
    assert tuned.quadctl("param", "dump").out == (tuned.folder / "dump.toml").read_text()
    again = tuned.quadctl("param", "dump", "safety", "-o", "dump.toml", "--json")
    assert (again.code, again.error["message"]) == (6, "dump.toml already exists")
    assert load(tuned.folder / "dump.toml") == wanted
    for command in ("load", "diff"):
        assert tuned.quadctl("param", command, "dump.toml") == (0, "", "")
    part = tuned.quadctl("param", "dump", "safety.virtual_cage", "/state_safety_node/takeoff").out
    assert dict(flatten(tomllib.loads(part))) == {
        "safety.virtual_cage.x": 5, "safety.virtual_cage.y": 5, "safety.virtual_cage.z": 2,
        "safety.takeoff": 2,
    }  # fmt: skip


def test_diff_shows_what_was_set_and_save_keeps_every_comment(tuned: Lab):
    file = tuned.folder / "quad.toml"
    before = file.read_text(encoding="utf-8").splitlines()
    assert tuned.quadctl("param", "set", "safety.virtual_cage.x=3", "safety.takeoff=1.5").code == 0
    changed = [
        "safety.virtual_cage.x: 5.0 -> 3.0",
        "safety.takeoff: 1.0 -> 1.5",
        "dynamics.seed: 0 -> 7",
        "supervise.answer_timeout: 2.0 -> 3.0",
    ]
    assert tuned.quadctl("param", "diff").out.splitlines() == changed
    assert tuned.quadctl("param", "diff", "--json").json[1] == {
        "name": "safety.takeoff", "file": 1.0, "running": 1.5,
    }  # fmt: skip
    assert tuned.quadctl("param", "save").out.splitlines() == changed
    after = file.read_text(encoding="utf-8").splitlines()
    assert len(after) == len(before)
    assert [new for old, new in zip(before, after, strict=True) if old != new] == [
        "virtual_cage = { x = 3.0, y = 5.0, z = 2.0 }",
        "takeoff = 1.5",
        "seed = 7",
        "answer_timeout = 3.0",
    ]
    assert tuned.quadctl("param", "diff").out == ""
    inode = file.stat().st_ino
    assert tuned.quadctl("param", "save", "--json").json == {"file": "quad.toml", "changed": []}
    assert file.stat().st_ino == inode


def test_save_keeps_the_encoding_and_the_line_ends_of_the_file(tuned: Lab):
    file = tuned.folder / "notepad.toml"
    file.write_bytes("# Höhe\r\n[safety]\r\ntakeoff = 1.0\r\n".encode("utf-16"))
    assert tuned.quadctl("param", "set", "safety.takeoff=1.5").code == 0
    assert tuned.quadctl("param", "save", "notepad.toml").code == 0
    text = file.read_bytes().decode("utf-16")
    assert text.startswith("# Höhe\r\n[safety]\r\ntakeoff = 1.5\r\n")
    assert "\n" not in text.replace("\r\n", "")
    assert tuned.quadctl("param", "diff", "notepad.toml") == (0, "", "")


def test_a_file_from_init_loads_except_for_another_seed(tuned: Lab):
    refused = tuned.quadctl("param", "load", "quad.toml")
    assert (refused.code, refused.out) == (6, "")
    assert "fixed at launch: dynamics.seed: 7 -> 0" in refused.err
    file = tuned.folder / "quad.toml"
    told = file.read_text(encoding="utf-8").replace("seed = 0", "seed = 7")
    file.write_text(told.replace("answer_timeout = 2.0", "answer_timeout = 3.0"), encoding="utf-8")
    assert tuned.quadctl("param", "load", "quad.toml") == (0, "", "")


def test_a_file_with_one_bad_value_changes_nothing(tuned: Lab):
    before = parameters(tuned)
    files = {
        "[pressure]\nrate = 20.0\n[safety]\ntakeoff = -1.0\n": "safety.takeoff",
        "[pressure]\nrate = 20.0\n[dynamics]\nspeed = 3.0\nseed = 7\n": "fixed at launch: dynamics.speed",
        "[pressure]\nrate = 20.0\n[supervise]\nanswer_timeout = 9.0\n": "supervise.answer_timeout",
        "[pressure]\nrate = 20.0\n[processes]\nmine = 'sleep 9'\n": "processes.mine: (none)",
        "[pressure]\nrate = 20.0\n[dynamics]\nrate = 300.0\n": "whole number",
        "[pressure]\nrate = 20.0\nrate = 30.0\n": "not TOML",
    }
    for text, told in files.items():
        done = tuned.quadctl("param", "load", tuned.file(text), "--json")
        assert (done.code, done.out, done.error["code"]) == (6, "", "invalid")
        assert told in done.error["message"]
    assert parameters(tuned) == before


@pytest.mark.thorough
def test_a_file_sets_several_nodes_and_leaves_the_rest_unchanged(tuned: Lab):
    before = parameters(tuned)
    text = "[pressure]\nrate = 20\n[safety]\nvirtual_cage = { x = 4 }\n[dynamics]\nseed = 7\n"
    done = tuned.quadctl("param", "load", tuned.file(text), "--json")
    assert (done.code, done.json) == (
        0,
        [
            {"name": "pressure.rate", "before": 10.0, "after": 20.0},
            {"name": "safety.virtual_cage.x", "before": 5.0, "after": 4.0},
        ],
    )
    assert parameters(tuned) == before | {"pressure.rate": 20.0, "safety.virtual_cage.x": 4.0}


@pytest.mark.thorough
def test_param_describe_shows_the_current_value(tuned: Lab):
    assert tuned.quadctl("param", "set", "/state_safety_node/takeoff", 2).code == 0
    done = tuned.quadctl(
        "param", "describe", "safety.takeoff", "dynamics.seed", "supervise", "--json"
    )
    values = {leaf["name"]: (leaf["value"], leaf["fixed_at_launch"]) for leaf in done.json}
    assert values == {
        "safety.takeoff": (2.0, False),
        "dynamics.seed": (7, True),
        "supervise.answer_timeout": (3.0, True),
    }


@pytest.mark.thorough
def test_param_set_accepts_the_output_of_param_get(tuned: Lab):
    got = tuned.quadctl("param", "get", "safety").out.splitlines()
    assert "safety.cage_on: true" in got
    # Without `cage_on`, the cage's state at launch: `cage on` and `cage off` change the current one.
    words = [line.replace(": ", "=", 1) for line in got if "cage_on" not in line]
    said = tuned.quadctl("param", "set", *words).out.splitlines()
    assert said == [line for line in got if "cage_on" not in line]
    assert tuned.quadctl("param", "get", "safety.cage_on").out == "true\n"
    assert tuned.quadctl("param", "get", "supervise").out == "supervise.answer_timeout: 3.0\n"
    refused = tuned.quadctl("param", "set", "supervise.answer_timeout", 2, "--json")
    assert (refused.code, "fixed at launch" in refused.error["message"]) == (6, True)


@pytest.mark.thorough
def test_param_list_reports_a_node_that_does_not_answer(tuned: Lab):
    names = tuned.quadctl("param", "list").out.splitlines()
    assert {"safety.takeoff", "hub.transport", "supervise.answer_timeout"} <= set(names)
    with tuned.bare() as bare:
        token = bare.session.liveliness().declare_token(OFFER.format("ghost"))
        done = tuned.quadctl("param", "list", "--timeout", 0.5, "--json")
        assert (done.code, done.json) == (3, names)
        assert "ghost/get_params" in done.error["message"]
        # A foreign node has no table in the file, so a dump does not need it.
        assert tuned.quadctl("param", "dump", "--json").code == 0
        token.undeclare()


@pytest.mark.thorough
def test_a_load_that_fails_halfway_reports_its_progress(lab: Lab):
    lab.start("--without", "safety")
    with lab.bare() as bare:
        served = _stubborn(bare)
        text = "[pressure]\nrate = 20.0\n[safety]\ntakeoff = 2.0\n[dynamics]\nrate = 50.0"
        done = lab.quadctl("param", "load", lab.file(text), "--json")
        assert (done.code, done.out) == (6, "")
        assert done.error["message"] == (
            "not today; changed: pressure.rate: 10.0 -> 20.0; "
            "failed: safety.takeoff: 1.0 -> 2.0; not tried: dynamics.rate: 100.0 -> 50.0"
        )
        for each in served:
            each.undeclare()
    now = json.loads(lab.quadctl("param", "get", "pressure.rate", "dynamics", "--json").out)
    assert (now["pressure.rate"], now["dynamics.rate"]) == (20.0, 100.0)
    # Without a safety node it fails before any change.
    done = lab.quadctl("param", "load", lab.file(text.replace("20.0", "30.0")), "--json")
    assert (done.code, "nothing was changed" in done.error["message"]) == (3, True)
    assert lab.quadctl("param", "get", "pressure.rate").out == "20.0\n"


def _stubborn(bare: Bare) -> list[Any]:
    """Declare a safety node that shows its parameters and refuses every change."""

    def replying(answer: Any) -> Any:
        def reply(query: zenoh.Query) -> None:
            with query:
                query.reply(query.key_expr, pack(answer))

        return reply

    answers = {
        "get_params": {"values": {"safety.takeoff": 1.0}},
        "set_params": {"success": False, "reason": "not today"},
    }
    served: list[Any] = [
        bare.session.declare_queryable(f"uav/@srv/safety/{name}", replying(answer), complete=True)
        for name, answer in answers.items()
    ]
    return [*served, bare.session.liveliness().declare_token(OFFER.format("safety"))]


@pytest.mark.thorough
def test_param_save_through_a_link_keeps_the_link_and_the_mode(tuned: Lab):
    real: Path = tuned.file("# mine\n[safety] # all of it\ntakeoff = 9.0 # high\n", "real.toml")
    real.chmod(0o640)
    link = tuned.folder / "link.toml"
    link.symlink_to("real.toml")
    assert tuned.quadctl("param", "save", "link.toml").code == 0
    assert link.is_symlink()
    text = real.read_text(encoding="utf-8")
    assert text.startswith("# mine\n[safety] # all of it\ntakeoff = 1.0 # high\n")
    assert real.stat().st_mode & 0o777 == 0o640
    assert load(real) == load(None, ("safety.virtual_cage.z=2", "dynamics.seed=7",
                                     "supervise.answer_timeout=3"))  # fmt: skip
