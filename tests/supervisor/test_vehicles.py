"""Several vehicles in one run: own keys, independent flights, four processes for all."""

import re
import signal
import sys
import time
from collections.abc import Iterator
from functools import partial

import pytest

from tests.support.lab import NODES, PATIENT, Lab, private_lab, sets
from tests.support.proofs import Proofs
from tests.support.running import eventually

HIDDEN = """
from importlib import util

find = util.find_spec
util.find_spec = lambda name, package=None: None if name == "numba" else find(name, package)
"""


@pytest.fixture
def without_numba(lab: Lab) -> Lab:
    """Lab with processes that cannot import numba."""
    (lab.folder / "sitecustomize.py").write_text(HIDDEN, encoding="utf-8")
    lab.environment["PYTHONPATH"] = str(lab.folder)
    return lab


def test_too_many_vehicles_are_refused_before_anything_starts(without_numba: Lab):
    lab = without_numba
    # Worth a million steps a second; plain Python does a few hundred thousand at most.
    done = lab.quadctl("up", "-d", "--vehicles", 200, "--set", "dynamics.rate=1000")
    assert done.code == 2
    assert "vehicles at 1000 Hz in plain Python, 200 were asked for" in done.err
    assert "pip install 'quadctl[fleet]'" in done.err
    assert done.out == ""
    assert not lab.home.exists()
    assert lab.quadctl("status").code == 3


@pytest.mark.thorough
def test_two_vehicles_fly_without_numba(without_numba: Lab):
    lab = without_numba
    lab.start("--vehicles", 2, "--set", "dynamics.rate=20")
    done = lab.quadctl("fleet", "goto", "0", "0", "1.5")
    assert done.code == 0, done.err
    assert "compil" not in lab.log("dynamics")


@pytest.mark.thorough
def test_all_of_a_large_launch_take_off(lab: Lab):
    """The first ones wait for the last: meanwhile they would fly without setpoints, and stop."""
    wide = sets("safety.virtual_cage.x=30", "safety.virtual_cage.y=30", "dynamics.rate=20")
    lab.start("--vehicles", 200, *wide, *PATIENT)
    eventually(lambda: lab.log("safety").count("Current State: HOVERING\n") == 200, 60.0)
    assert "stopped" not in lab.log("safety")


SLOW = """
[processes]
pressure = ["sh", "-c", "sleep 4; exec python -P -m quadctl.services.pressure"]
"""


def test_a_start_that_takes_long_says_how_far_it_is(lab: Lab):
    done = lab.quadctl("up", "-d", lab.file(SLOW), "--vehicles", 2)
    assert (done.code, done.out) == (0, f"realm {lab.realm} is up\n")
    # Every 3 s; on a busy machine other nodes take long, too.
    *progress, own = done.err.splitlines()
    assert progress
    assert all(re.fullmatch(r"starting: [0-6] of 8 nodes are ready", line) for line in progress)
    assert own.startswith("pressure: sh -c ")
    assert lab.log("up").splitlines() == progress


BUSY = 10
"""Processes that compute all the time, so that the load is 10."""


@pytest.mark.prove
@pytest.mark.alone
def test_two_hundred_vehicles_start_at_a_load_of_ten(lab: Lab, proofs: Proofs):
    busy = [lab.spawn(sys.executable, "-c", "while True: pass") for _ in range(BUSY)]
    took = []
    for _ in range(4):
        began = time.monotonic()
        done = lab.quadctl("up", "-d", "--vehicles", 200, timeout=120.0)
        took.append(time.monotonic() - began)
        assert done.code == 0, done.err
        assert lab.quadctl("down", timeout=60.0).code == 0
    for each in busy:
        each.end()
    proofs.add(
        f"`up --vehicles 200` beside {BUSY} processes that compute all the time",
        f"{len(took)} of {len(took)} starts, in {min(took):.1f} to {max(took):.1f} s",
        "all",
    )


VEHICLES = ["uav0", "uav1", "uav2"]


@pytest.fixture(scope="module")
def three_vehicles() -> Iterator[Lab]:
    """Three hovering vehicles, the last one higher."""
    with private_lab() as made:
        made.share("--vehicles", 3, "--set", "uav2.safety.takeoff=2", *PATIENT)
        for vehicle in VEHICLES:
            eventually(partial(is_up, made, vehicle))
        yield made


@pytest.fixture
def at_start(three_vehicles: Lab) -> Lab:
    """The three vehicles as launched, whatever earlier tests have left."""
    three_vehicles.put_back()
    return three_vehicles


def height(lab: Lab, vehicle: str) -> float:
    return float(lab.quadctl("state", "--vehicle", vehicle, "--json").json["pose"]["position"]["z"])


def is_up(lab: Lab, vehicle: str) -> bool:
    return height(lab, vehicle) > 0.9


def position_of(lab: Lab, vehicle: str) -> tuple[float, float]:
    at = lab.quadctl("state", "--vehicle", vehicle, "--json").json["pose"]["position"]
    return round(at["x"], 1), round(at["y"], 1)


@pytest.mark.thorough
def test_four_processes_fly_all_vehicles(three_vehicles: Lab):
    status = three_vehicles.quadctl("status", "--json").json
    assert status["vehicles"] == VEHICLES
    assert [node["name"] for node in status["nodes"]] == NODES
    assert "vehicles uav0, uav1, uav2" in three_vehicles.quadctl("status").out
    with three_vehicles.bare() as bare:
        poses = {vehicle: bare.watch(f"{vehicle}/pose") for vehicle in VEHICLES}
        boots = {watch.next()[0]["boot"] for watch in poses.values()}
    assert len(boots) == 3


@pytest.mark.thorough
def test_vehicles_start_on_a_grid_each_with_its_own_settings(at_start: Lab):
    assert [position_of(at_start, vehicle) for vehicle in VEHICLES] == [(-1, -1), (1, -1), (-1, 1)]
    eventually(lambda: height(at_start, "uav2") > 1.9)
    assert height(at_start, "uav0") < 1.1


@pytest.mark.thorough
@pytest.mark.parametrize(
    "line",
    ["goto 0 0 1", "hold", "reset", "state", "calibrate", "cage show", "cage off",
     "topic echo pose -n 1", "topic hz pose -n 3", "service call hold",
     "param get safety.takeoff", "doctor", "fly mission.toml"],
)  # fmt: skip
def test_a_command_without_a_vehicle_lists_the_vehicles(three_vehicles: Lab, line: str):
    three_vehicles.file('rows = [{ at = 0.05, do = "hold" }]', "mission.toml")
    done = three_vehicles.quadctl(*line.split())
    assert (done.code, done.out) == (2, "")
    assert "there are several vehicles: uav0, uav1, uav2" in done.err
    assert "--vehicle uav0" in done.err


@pytest.mark.thorough
def test_listings_show_all_vehicles_and_name_the_vehicle_of_each_line(three_vehicles: Lab):
    lines = ["topic list", "service list", "node list", "graph"]
    done = three_vehicles.each([*lines, "param list safety", "status"])
    shown = {line: done[line].out.splitlines() for line in lines}
    for line, (title, *rows) in shown.items():
        assert title.startswith("VEHICLE "), line
        assert {row.split()[0] for row in rows} == set(VEHICLES), line
        one = three_vehicles.quadctl(*line.split(), "--vehicle", "uav1").out
        own = [row.partition(" ")[2].split() for row in rows if row.startswith("uav1 ")]
        assert [row.split() for row in one.splitlines()[1:]] == own, line
    assert "uav1.safety.takeoff" in done["param list safety"].out.splitlines()
    assert done["status"].out.splitlines()[1].startswith("VEHICLES ")


@pytest.mark.thorough
def test_a_full_key_selects_its_vehicle(at_start: Lab):
    echoed = at_start.quadctl("topic", "echo", "/uav2/pose", "-n", 1, "--json").json
    assert round(echoed["position"]["y"]) == 1
    assert at_start.quadctl("service", "call", "/uav1/hold").code == 0
    assert at_start.quadctl("topic", "info", "uav0/sensors/pressure").code == 0
    everybody = at_start.quadctl("topic", "echo", "*/safety/state", "-n", 3, "--json")
    assert everybody.code == 0, everybody.err


@pytest.mark.thorough
def test_a_parameters_name_may_begin_with_its_vehicle(at_start: Lab):
    done = at_start.quadctl("param", "set", "uav1.safety.acceptance_range", 0.4)
    assert (done.code, done.out) == (0, "safety.acceptance_range: 0.4\n")
    for vehicle, known in (("uav0", 0.5), ("uav1", 0.4)):
        found = at_start.quadctl(
            "param", "get", f"{vehicle}.safety.acceptance_range", "--json"
        ).json
        assert found == {"safety.acceptance_range": known}
        dumped = at_start.quadctl("param", "dump", f"{vehicle}.safety.acceptance_range", "--json")
        assert dumped.json == found
    both = at_start.quadctl("param", "get", "uav0.safety.takeoff", "uav1.safety.takeoff")
    assert (both.code, "different vehicles: uav0, uav1" in both.err) == (2, True)


@pytest.mark.thorough
def test_an_unknown_vehicle_is_reported_with_the_existing_ones(three_vehicles: Lab):
    done = three_vehicles.quadctl("goto", 0, 0, 1, "--vehicle", "drone", "--timeout", 2)
    assert done.code == 3
    assert "this run has no vehicle drone" in done.err
    assert "it has uav0, uav1, uav2" in done.err


@pytest.mark.thorough
def test_a_listing_of_an_unknown_vehicle_is_no_empty_table(three_vehicles: Lab):
    lines = ["topic list", "service list", "node list", "graph", "graph --json", "graph --dot",
             "param list", "param dump", "param diff", "node info safety", "node ping safety"]  # fmt: skip
    for line, done in three_vehicles.each([f"{line} --vehicle drone" for line in lines]).items():
        assert (done.code, "no vehicle drone" in done.err + done.out) == (3, True), line
        assert "it has uav0, uav1, uav2" in done.err + done.out, line


def test_each_vehicle_has_its_own_flight_cage_baseline_and_params(at_start: Lab):
    def ask(*words: object, vehicle: str = "uav1") -> dict[str, object]:
        done = at_start.quadctl(*words, "--vehicle", vehicle, "--json")
        assert done.code == 0, done.err
        answer: dict[str, object] = done.json
        return answer

    assert ask("goto", 2, 1, 1)["arrived"]
    assert position_of(at_start, "uav0") == (-1, -1)
    ask("cage", "off")
    assert ask("cage", "show")["on"] is False
    assert ask("cage", "show", vehicle="uav0")["on"] is True
    assert float(str(ask("calibrate")["baseline"])) > 1000
    with at_start.bare() as bare:
        first, second = (bare.watch(f"{v}/sensors/pressure").next()[0] for v in ("uav0", "uav1"))
    assert (first["baseline"], first["samples"]) == (0, 0)
    assert second["baseline"] > 1000
    ask("param", "set", "safety.acceptance_range", 0.25)
    assert ask("param", "get", "safety.acceptance_range") == {"safety.acceptance_range": 0.25}
    assert ask("param", "get", "safety.acceptance_range", vehicle="uav0") == {
        "safety.acceptance_range": 0.5
    }


@pytest.mark.thorough
def test_a_file_is_compared_and_saved_by_vehicle(three_vehicles: Lab):
    said = "# kept\n[safety]\ntakeoff = 1.0\npose_timeout = 0.6\n"
    file = three_vehicles.file(f"{said}[dynamics]\nsetpoint_timeout = 0.6\n", "saved.toml")
    assert three_vehicles.quadctl("param", "diff", "saved.toml", "--vehicle", "uav0").out == ""
    assert three_vehicles.quadctl("param", "diff", "saved.toml", "--vehicle", "uav2").out == (
        "safety.takeoff: 1.0 -> 2.0\n"
    )
    assert three_vehicles.quadctl("param", "save", "saved.toml", "--vehicle", "uav2").code == 0
    assert file.read_text().startswith(said)
    assert "[uav2.safety]\ntakeoff = 2.0" in file.read_text()
    assert three_vehicles.quadctl("param", "diff", "saved.toml", "--vehicle", "uav2").out == ""
    assert three_vehicles.quadctl("param", "load", "saved.toml", "--vehicle", "uav0").out == ""


@pytest.mark.thorough
def test_doctor_passes_for_each_vehicle(three_vehicles: Lab):
    for vehicle in VEHICLES[:2]:
        found = three_vehicles.quadctl("doctor", "--vehicle", vehicle, "--json")
        assert found.json["ok"], found.out
    none = three_vehicles.quadctl("doctor", "--vehicle", "uav9", "--json")
    assert none.code == 8


@pytest.mark.thorough
@pytest.mark.parametrize("node", ["safety", "pressure", "dynamics", "hub"])
def test_a_killed_process_returns_for_all_vehicles(three_vehicles: Lab, node: str):
    old = three_vehicles.signal(node, signal.SIGKILL)
    three_vehicles.revived(node, old)
    eventually(three_vehicles.is_ready)
    for x, vehicle in enumerate(VEHICLES):
        # Straight up from where it was left, so apart from the others.
        done = three_vehicles.quadctl(
            "goto", 2 * (x % 2), 2 * (x // 2), 1, "--wait", "--replace", "--vehicle", vehicle
        )
        assert done.code == 0, done.err


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--vehicles", 0], 2, "--vehicles 0: not a number of vehicles"),
        (["--vehicles", 2, "--set", "uav2.safety.takeoff=2"], 6, "unknown parameter uav2"),
        (["--vehicles", 2, "--set", "uav1.hub.transport=tcp"], 6, "all vehicles share one"),
    ],
)
def test_impossible_vehicle_settings_are_refused_before_the_start(
    lab: Lab, words: list[object], code: int, said: str
):
    done = lab.quadctl("up", "-d", *words)
    assert done.code == code
    assert said in done.err
    assert lab.quadctl("status").code == 3


@pytest.mark.thorough
@pytest.mark.parametrize(("count", "picked"), [(2, ["uav1"]), (300, ["uav150", "uav299"])])
def test_a_vehicles_flight_does_not_depend_on_the_other_vehicles(
    lab: Lab, count: int, picked: list[str]
):
    """Fly each vehicle up and down at its place: on any other way the others could bar it."""
    wide = sets("safety.virtual_cage.x=30", "safety.virtual_cage.y=30", "dynamics.speed=0")
    lab.start("--vehicles", count, *wide)
    own, among = dict[str, list[str]](), dict[str, dict[str, str]]()
    for vehicle in ["uav0", *picked]:
        own[vehicle] = [
            f"{name}={lab.quadctl('param', 'get', name, '--vehicle', vehicle).out.strip()}"
            for name in ("dynamics.start.x", "dynamics.start.y", "dynamics.seed")
        ]
        among[vehicle] = digest(lab, vehicle, own[vehicle])
    assert digest(lab, picked[0], own[picked[0]]) == among[picked[0]]
    assert lab.quadctl("down") == (0, f"realm {lab.realm} is down\n", "")
    assert len({flown["poses"] for flown in among.values()}) == len(among)
    for vehicle in picked:
        lab.start("--vehicle", vehicle, *wide, *sets(*own[vehicle]))
        assert digest(lab, vehicle, own[vehicle]) == among[vehicle]
        assert lab.quadctl("down") == (0, f"realm {lab.realm} is down\n", "")


def digest(lab: Lab, vehicle: str, own: list[str]) -> dict[str, str]:
    """Fly a vehicle up and down from its own start; return the hashes of the flight."""
    x, y, _ = (each.partition("=")[2] for each in own)
    up, down = (
        f'{{ at = {at}, do = "goto", x = {x}, y = {y}, z = {z} }}'
        for at, z in ((0.5, 1.5), (3.0, 0.5))
    )
    lab.file(f"end = 4.0\nrows = [{up}, {down}]", "mission.toml")
    done = lab.quadctl("fly", "mission.toml", "--vehicle", vehicle, "--json")
    assert done.code == 0, done.err
    assert [row["accepted"] for row in done.json["rows"]] == [True, True]
    return {name: done.json[name] for name in ("poses", "transitions", "pressure")}


@pytest.mark.thorough
def test_vehicles_fly_while_compiling_and_down_ends_the_compiler(lab: Lab):
    lab.environment["XDG_CACHE_HOME"] = str(lab.folder / "cache")
    lab.start("--vehicles", 2, *PATIENT)
    eventually(lambda: "compiling the vehicle" in lab.log("dynamics"))
    eventually(lambda: len(lab.processes()) > 1 + len(NODES))
    eventually(partial(is_up, lab, "uav1"))
    # The fixture asserts that no process is left.
    assert lab.quadctl("down").code == 0
