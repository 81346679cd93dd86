"""Several vehicles on separate hubs: a hub that is away does not delay the others."""

import json
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.support.lab import Lab, private_lab, sets
from tests.support.running import eventually

FILE = """
[vehicles]
uav0 = {{}}
uav1 = {{}}
red = {{ connect = "{red}", vehicle = "uav" }}
[formations.line]
uav0 = [-2.0, 0.0, 0.0]
uav1 = [0.0, 0.0, 0.0]
red = [2.0, 0.0, 0.5]
"""
NAMES = ["uav0", "uav1", "red"]
LONG_TIMEOUTS = ("--set", "dynamics.start.z=1", "--set", "safety.pose_timeout=5",
        "--set", "dynamics.setpoint_timeout=5", "--set", "supervise.answer_timeout=60")  # fmt: skip
"""Long timeouts: on a busy machine no vehicle must stop because a process waits for a core."""


@pytest.fixture(scope="module")
def fleet() -> Iterator[tuple[Lab, Lab]]:
    """Lab with two vehicles on one hub and the fleet file, and a lab with one vehicle on another hub."""
    with private_lab() as two, private_lab() as one:
        two.start("--vehicles", 2, *LONG_TIMEOUTS)
        one.start(*LONG_TIMEOUTS)
        two.file(FILE.format(red=endpoint(one)), "fleet.toml")
        yield two, one


def endpoint(lab: Lab) -> str:
    return f"unixsock-stream/{lab.home / 'hub.sock'}"


@contextmanager
def silent_hub() -> Iterator[str]:
    """Open a server that accepts connections but never answers."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"tcp/127.0.0.1:{server.getsockname()[1]}"


def file_with_a_mute_vehicle(lab: Lab, one: Lab, silent: str) -> Path:
    mute = f'mute = {{ connect = "{silent}" }}'
    red = f'red = {{ connect = "{endpoint(one)}", vehicle = "uav" }}'
    return lab.file(f"[vehicles]\n{mute}\n{red}", "mute.toml")


def listed(lab: Lab, *words: object) -> dict[str, dict[str, Any]]:
    done = lab.quadctl("fleet", "list", "--json", *words)
    assert done.code == 0, done
    return {row["vehicle"]: row for row in done.json}


def test_fleet_list_shows_position_goal_and_state_of_each(fleet: tuple[Lab, Lab]):
    two, one = fleet
    rows = listed(two)
    assert list(rows) == NAMES
    assert rows["red"]["hub"] == endpoint(one)
    assert rows["uav0"]["hub"] == f"realm {two.realm}"
    for row in rows.values():
        assert row["state"] == "HOVERING"
        assert (row["cage_on"], row["error"]) == (True, None)
        assert set(row["position"]) == set(row["goal"]) == set("xyz")
        assert 0 <= row["age"] < 10
    done = two.quadctl("fleet", "list")
    assert done.code == 0, done
    shown = done.out.splitlines()
    assert shown[0].split() == [
        "VEHICLE", "HUB", "STATE", "GOAL", "POSITION", "CAGE", "AGE", "PROBLEM",
    ]  # fmt: skip
    assert [line.split()[0] for line in shown[1:]] == NAMES


@pytest.mark.thorough
def test_fleet_list_without_a_file_shows_all_vehicles_of_the_hub(fleet: tuple[Lab, Lab]):
    two, one = fleet
    assert list(listed(one)) == ["uav"]
    with two.bare() as bare:
        # A recorder may outlive the run of its vehicle.
        token = bare.session.liveliness().declare_token("uav/@node/recorder")
        over = one.quadctl("fleet", "list", "--json", "--connect", endpoint(two))
        token.undeclare()
    assert [row["vehicle"] for row in over.json] == ["uav0", "uav1"]


@pytest.mark.thorough
def test_fleet_goto_takes_a_formation_named_goals_or_a_centre(fleet: tuple[Lab, Lab]):
    two, _ = fleet
    done = two.quadctl("fleet", "goto", "line", 0, 1, 1, "--json")
    assert done.code == 0, done
    assert [(row["vehicle"], row["accepted"], row["arrived"]) for row in done.json] == [
        (name, True, True) for name in NAMES
    ]
    moved = two.quadctl("fleet", "goto", "--no-wait", "--replace", -1, 0, 1.5)
    # In any order: hub by hub, as the answers come.
    assert (moved.code, sorted(moved.out.splitlines())) == (
        0,
        [f"{name}: accepted" for name in sorted(NAMES)],
    )
    rows = listed(two)
    goals = {name: row["goal"] for name, row in rows.items()}
    assert {goal["y"] for goal in goals.values()} == {0.0}
    assert [goals[name]["x"] for name in NAMES] == pytest.approx([-3, -1, 1])
    own = two.quadctl("fleet", "goto", "uav1=0,2,1", "red=9,0,1", "--replace")
    assert own.code == 5
    assert "uav1: accepted\n" in own.out
    assert "red: rejected: outside the cage: x = 9" in own.out
    assert "uav1: arrived within " in own.out
    assert own.err.startswith("error: red: outside the cage: x = 9 is beyond [-5, 5]")


@pytest.mark.thorough
def test_fleet_commands_name_the_vehicles_they_leave_out(fleet: tuple[Lab, Lab]):
    two, one = fleet
    text = FILE.format(red=endpoint(one)).replace("uav1", "# uav1")
    whole = (two.folder / "fleet.toml").read_text(encoding="utf-8")
    two.file(text, "fleet.toml")
    try:
        left_out = "from fleet.toml; uav1, which is live on this hub, is not in it\n"
        assert two.quadctl("fleet", "list").err == left_out
        assert two.quadctl("fleet", "list", "--json").err == ""
    finally:
        two.file(whole, "fleet.toml")
    file = two.file(whole.replace("red = [", "# red = ["), "stays.toml")
    words = ("fleet", "goto", "line", 0, 0, 1, "--no-wait", "--replace", "--fleet", file)
    done = two.quadctl(*words)
    assert done == (0, "uav0: accepted\nuav1: accepted\n", "red has no place in line: it stays\n")


@pytest.mark.thorough
def test_refusals_are_reported_in_one_document(fleet: tuple[Lab, Lab]):
    two, _ = fleet
    assert two.quadctl("fleet", "hold").code == 0
    assert two.quadctl("fleet", "goto", "uav0=0,0,1", "uav1=2,0,1").code == 0
    far = two.quadctl("fleet", "goto", "uav0=4,4,1", "uav1=-4,-4,1", "--no-wait", "--replace")
    assert far.code == 0, far
    done = two.quadctl("fleet", "goto", "uav0=0,0,1", "uav1=1,0,1", "--json")
    assert (done.code, len(done.json), len(done.err.splitlines())) == (5, 2, 1)
    assert all(row["error"]["message"].startswith("busy") for row in done.json)
    assert "uav0: busy" in done.error["message"]
    assert "uav1: busy" in done.error["message"]
    assert "--replace" in done.error["hint"]
    assert two.quadctl("fleet", "hold").code == 0
    nowhere = two.quadctl("fleet", "goto", "line", 9999, 0, 1)
    assert (nowhere.code, nowhere.err.splitlines()[0]) == (
        6, "error: about 9999 0 1, red's x = 10001 is not a valid coordinate",
    )  # fmt: skip


@pytest.mark.thorough
def test_land_all_lands_all_and_can_be_repeated(fleet: tuple[Lab, Lab]):
    two, one = fleet
    assert two.quadctl("fleet", "goto", "line", 1, 1, 1, "--no-wait", "--replace").code == 0
    for _ in range(2):
        done = two.quadctl("fleet", "land-all", "--json")
        assert (done.code, [row["landed"] for row in done.json]) == (0, [True] * 3), done
        with one.bare() as bare:
            pose, state = bare.watch("uav/pose").next()[0], bare.state()
        assert pose["position"]["z"] < 0.05
        assert (state["state"], state["goal"]["z"]) == ("HOVERING", 0.0)
    assert two.quadctl("fleet", "goto", "line", 0, 0, 1).code == 0, "the vehicles fly again"


@pytest.mark.thorough
def test_an_unreachable_hub_is_reported_and_the_others_obey(fleet: tuple[Lab, Lab]):
    two, one = fleet
    text = FILE.format(red=endpoint(one)).replace("[formations.line]", "%s[formations.line]")
    with silent_hub() as silent:
        away = f'dead = {{ connect = "tcp/127.0.0.1:1" }}\nmute = {{ connect = "{silent}" }}\n'
        file = two.file(text % away, "away.toml")
        done = two.quadctl("fleet", "hold", "--fleet", file, "--timeout", 3, "--json")
        stopped = {row["vehicle"]: row["stopped"] for row in done.json}
        assert stopped == dict.fromkeys(NAMES, True) | {"dead": False, "mute": False}
        errors = {row["vehicle"]: row["error"] for row in done.json if row["error"]}
        codes = {name: error["code"] for name, error in errors.items()}
        assert codes == {"dead": "unreachable", "mute": "timeout"}
        assert (done.code, done.error["code"]) == (3, "unreachable")
        rows = two.quadctl("fleet", "list", "--fleet", file, "--timeout", 3)
        assert rows.code == 3
        assert [line.split()[0] for line in rows.out.splitlines()[1:]] == [*NAMES, *codes]
        assert "unreachable: nothing answers at tcp/127.0.0.1:1" in rows.out
        # The centre is unknown without the mute vehicle: no vehicle is sent.
        before = listed(two)
        # The dead one is known at once, however long the mute one may take.
        words = ("fleet", "goto", 0, 0, 2, "--fleet", file, "--timeout", 60, "--json")
        done = two.quadctl(*words)
        assert (done.code, done.out) == (3, "")
        said = "no vehicle was sent: the formation's centre needs all; dead: nothing answers"
        assert done.error["message"].startswith(said)
        assert "fleet goto uav0=1,2,1" in done.error["hint"]
        assert {n: r["goal"] for n, r in listed(two).items()} == {
            n: r["goal"] for n, r in before.items()
        }


@pytest.mark.thorough
@pytest.mark.parametrize("verb", ["hold", "land-all"])
def test_a_silent_hub_does_not_delay_the_other_vehicles(fleet: tuple[Lab, Lab], verb: str):
    two, one = fleet
    with silent_hub() as silent, one.bare() as bare:
        states = bare.watch("uav/safety/state")
        file = file_with_a_mute_vehicle(two, one, silent)
        assert bare.call("goto", x=4.0, y=-4.0, z=2.0, replace=True).value["accepted"]
        run = two.spawn(*two.command("fleet", verb, "--fleet", file, "--timeout", 60))
        states.until(lambda s: s["reason"] == "hold: stopped on request")
        if verb == "land-all":
            states.until(lambda s: s["goal"]["z"] == 0 and s["state"] == "HOVERING")
        assert not run.ended, run.log
        run.send(signal.SIGINT)
        assert run.wait() == 130, run.log


@pytest.mark.thorough
def test_ctrl_c_reports_that_accepted_flights_go_on(fleet: tuple[Lab, Lab]):
    two, one = fleet
    with silent_hub() as silent, one.bare() as bare:
        states = bare.watch("uav/safety/state")
        file = file_with_a_mute_vehicle(two, one, silent)
        words = ("mute=1,1,1", "red=-4,4,2", "--replace", "--fleet", file, "--timeout", 60)
        run = two.spawn(*two.command("fleet", "goto", *words))
        states.until(lambda s: s["goal"]["x"] == -4 and s["state"] == "HOVERING")
        run.send(signal.SIGINT)
        assert run.wait() == 130
        went_on = "stopped waiting: the flights go on; `quadctl fleet hold` stops them\n"
        assert run.log == f"red: accepted\n{went_on}"


@pytest.mark.thorough
def test_a_frozen_vehicle_is_listed_with_its_known_fields(fleet: tuple[Lab, Lab]):
    two, one = fleet
    with one.bare() as bare:
        one.signal("dynamics", signal.SIGSTOP)
        try:
            # After a second frozen it counts as gone; before that, as not answering.
            eventually(lambda: "dynamics" not in bare.nodes())
            done = two.quadctl("fleet", "list", "--json", "--timeout", 3)
            assert done.code == 3
            rows = {row["vehicle"]: row for row in done.json}
            assert (rows["red"]["state"], rows["red"]["position"]) == ("HOVERING", None)
            assert rows["red"]["error"]["code"] == "unreachable"
            assert rows["uav0"]["error"] is None
        finally:
            one.signal("dynamics", signal.SIGCONT)
        eventually(lambda: "dynamics" in bare.nodes())


@pytest.mark.thorough
def test_a_vehicle_lands_in_gusts_with_a_small_acceptance_range(lab: Lab):
    wind = ("dynamics.wind.gust=0.75", "dynamics.wind.mean.x=5", "dynamics.seed=3")
    # About the least that is accepted there.
    settings = ("safety.acceptance_range=0.05", *wind, "dynamics.speed=5")
    assert lab.quadctl("up", "-d", *LONG_TIMEOUTS, *sets(*settings)).code == 0
    done = lab.quadctl("fleet", "land-all", "--json")
    assert done.code == 0, done
    assert json.loads(done.out)[0]["landed"]
    with lab.bare() as bare:
        assert bare.state()["state"] == "HOVERING", (
            "not busy with a goal that it has missed by a little"
        )
