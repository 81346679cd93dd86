"""Start of a system from a program, connections to one that runs, and what is left at the end."""

import subprocess
import sys
import textwrap
import traceback
from pathlib import Path

import pytest

import quadctl
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.run_files import read
from tests.support.running import DEADLINE, alive, eventually

FAST = {"dynamics.speed": 0}


def pids(realm: str) -> list[int]:
    run = read(Realm(realm))
    return [run.pid, *(process.pid for process in run.nodes)]


def gone(processes: list[int]) -> bool:
    return not any(map(alive, processes))


@pytest.mark.thorough
def test_a_run_ends_with_its_block_and_leaves_nothing():
    with quadctl.launch(params=FAST) as run:
        processes = pids(run.realm)
        assert len(processes) == 5
        folder = Realm(run.realm).folder
    assert gone(processes)
    assert not folder.exists()
    run.close()
    with pytest.raises(quadctl.Unreachable):
        quadctl.connect(run.realm)


@pytest.mark.thorough
def test_a_run_that_is_not_used_any_more_ends():
    run = quadctl.launch(params=FAST)
    processes = pids(run.realm)
    del run
    assert gone(processes)


@pytest.mark.thorough
@pytest.mark.parametrize("ending", ["os.kill(os.getpid(), 9)", "sys.exit(3)", "raise RuntimeError"])
def test_a_run_ends_with_its_program_however_that_ends(tmp_path: Path, ending: str):
    program = tmp_path / "program.py"
    program.write_text(
        textwrap.dedent(f"""
            import os, sys
            import quadctl
            run = quadctl.launch(params={{"dynamics.speed": 0}})
            print(run.realm, flush=True)
            sys.stdin.readline()
            {ending}
        """)
    )
    with subprocess.Popen(
        [sys.executable, program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as running:
        assert running.stdin is not None
        assert running.stdout is not None
        processes = pids(running.stdout.readline().strip())
        running.stdin.write("\n")
        running.stdin.flush()
        running.wait(DEADLINE)
    assert eventually(lambda: gone(processes))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [
        ({"params": {"safety.takeof": 1}}, quadctl.Invalid, "unknown parameter safety.takeof"),
        ({"params": {"safety.takeoff": "high"}}, quadctl.Invalid, "safety.takeoff: expected"),
        ({"config": "nowhere.toml"}, quadctl.Invalid, "nowhere.toml cannot be read"),
        ({"vehicles": 0}, quadctl.Error, "not a number of vehicles"),
        ({"realm": "a b"}, quadctl.Error, "'a b' is not a valid name for a realm"),
        (
            {"processes": {"safety": "nosuchprogram"}},
            quadctl.Invalid,
            "nosuchprogram was not found",
        ),
        ({"processes": {"safety": "false"}}, quadctl.Error, "safety"),
    ],
)
def test_a_launch_that_fails_names_the_fault_and_starts_nothing(arguments, error, said):
    with pytest.raises(error) as failed:
        quadctl.launch(**arguments)
    assert said in str(failed.value)
    assert "direct cause" not in "".join(traceback.format_exception(failed.value))
    assert "During handling" not in "".join(traceback.format_exception(failed.value))


def test_a_realm_is_launched_once_and_connected_to_by_any_number(monkeypatch):
    with quadctl.launch(params=FAST) as run:
        with pytest.raises(quadctl.AlreadyServed) as held:
            quadctl.launch(realm=run.realm)
        assert "launch(realm=...)" in held.value.hint
        assert "another --realm" not in "".join(traceback.format_exception(held.value))
        with quadctl.connect(run.realm) as quad:
            assert quad.name == "uav"
            assert quad.goto(1, 0, 1, replace=True).distance <= 0.5
        monkeypatch.setenv("QUADCTL_REALM", run.realm)
        with quadctl.connect(timeout=2.0) as quad:
            assert quad.state().goal.x == 1
        # The one who connected is gone; the system is not.
        assert run.vehicle.pose().boot


@pytest.mark.thorough
def test_a_file_and_a_nodes_command_are_found_beside_the_file(tmp_path: Path):
    (tmp_path / "quad.toml").write_text(
        "[safety]\ntakeoff = 2.0\n[dynamics]\nspeed = 0.0\n[processes]\nidle = './idle.sh'\n"
    )
    script = tmp_path / "idle.sh"
    script.write_text("#!/bin/sh\nexec sleep 60\n")
    script.chmod(0o700)
    with quadctl.launch(tmp_path / "quad.toml", params={"safety.acceptance_range": 0.3}) as run:
        assert run.vehicle.params["safety.takeoff"] == 2.0
        assert run.vehicle.params["safety.acceptance_range"] == 0.3
        assert "Param: takeoff - 2.0" in run.logs()["safety"]
        assert "idle" in {process.name for process in read(Realm(run.realm)).nodes}


@pytest.mark.thorough
def test_the_example_of_a_safety_node_verifies_each_goal():
    example = Path(__file__).parents[2] / "examples" / "my_safety.py"
    with quadctl.launch(processes={"safety": f"python {example}"}) as run:
        states = run.vehicle.watch("state", seconds=5)
        seen = [next(states)]  # from now on none is missed
        assert run.vehicle.goto(1, 0, 1).distance <= 0.5
        with pytest.raises(quadctl.Refused, match="outside the cage"):
            run.vehicle.goto(9, 0, 1)
        while seen[-1].request < 2 or seen[-1].state == "VERIFYING":
            seen.append(next(states))
    told = [(state.request, state.state) for state in seen]
    for request in (1, 2):
        assert (request, "VERIFYING") in told
    assert seen[-1].reason == "outside the cage"
