"""`campaign`: the same flights on any number of processes, each repeatable; exit 8 for a violation."""

import re
import signal
import sys
import time
from collections.abc import Iterator
from typing import Any

import pytest

from quadctl.cli import campaign as command
from quadctl.cli.campaign import lines
from quadctl.cli.context import options_of
from quadctl.schemas.params import MeanWindParams, WindParams
from quadctl.schemas.vehicle import ControlParams, VehicleParams
from quadctl.services.airspace.airworthiness import wind_margin
from quadctl.services.runtime import procfs
from quadctl.services.runtime.errors import QuadctlError
from tests.support.campaign_flights import kept
from tests.support.compiled import compiled_kernel
from tests.support.lab import Lab, private_lab, sets
from tests.support.proofs import Proofs
from tests.support.running import eventually

SHORT = ("campaign", "--flights", 6, "--seconds", 4, "--seed", 3)
SHAPE = {"flights", "seed", "worst_excursion", "transitions", "refusals", "violations", "hash"}

MARGIN = 0.01
"""Allowed excursion beyond the cage in still air, m."""
WINDY = MARGIN + wind_margin(
    VehicleParams(), ControlParams(), WindParams(MeanWindParams(3.0), gust=0.75)
)
"""The margin in force in the wind of the campaign, m."""


@pytest.fixture(scope="module")
def module_lab() -> Iterator[Lab]:
    """Realm in which nothing runs, because a campaign needs no system."""
    with private_lab() as made:
        yield made


@pytest.fixture(scope="module")
def report(module_lab: Lab) -> dict[str, Any]:
    compiled_kernel()
    done = module_lab.quadctl(*SHORT, "--json", "--processes", 1, timeout=200.0)
    assert done.code == 0  # stderr may report that the vehicle is being compiled
    document: dict[str, Any] = done.json
    return document


def test_a_campaign_is_independent_of_the_number_of_processes(
    module_lab: Lab, report: dict[str, Any]
):
    assert report.keys() >= SHAPE
    assert (report["flights"], report["seed"], report["violations"]) == (6, 3, [])
    assert report["transitions"]["VERIFYING -> MOVING"] > 0
    other = module_lab.quadctl(*SHORT, "--json", "--processes", 3, timeout=200.0)
    assert other.json == report


@pytest.mark.thorough
def test_a_flight_can_be_replayed_with_its_log(module_lab: Lab, report: dict[str, Any]):
    seed = report["worst"]["seed"]
    assert 3_000_000 <= seed < 3_000_006
    again = module_lab.quadctl("campaign", "--replay", seed, "--seconds", 4, "--json")
    assert again.code == 0
    assert again.json["worst_excursion"] == report["worst_excursion"]
    assert any("Current State: VERIFYING" in line for line in again.json["log"])
    first = module_lab.quadctl("campaign", "--replay", 3_000_000, "--seconds", 4, "--json")
    alone = module_lab.quadctl("campaign", "--flights", 1, *SHORT[3:], "--json")
    assert first.json["hash"] == alone.json["hash"], (
        "the flight is the same compiled and in plain Python"
    )
    told = module_lab.quadctl("campaign", "--replay", seed, "--seconds", 4)
    assert (told.code, told.err) == (0, "")
    assert re.search(r"^\d+\.\d\d s +goto x=", told.out, re.MULTILINE)
    assert told.out.splitlines()[-1] == f"SHA-256      {again.json['hash']}"


@pytest.mark.thorough
def test_a_killed_campaign_continues_from_its_database(lab: Lab):
    words = ("campaign", "--flights", 600, "--seconds", 20, "--json")
    compiled_kernel()
    database = lab.folder / "flights.sqlite"

    flying = lab.spawn(*lab.command(*words, "--db", database.name, "--processes", 1))
    eventually(lambda: kept(database) > 0)
    flying.send(signal.SIGKILL)
    flying.wait()
    eventually(lambda: not lab.processes())
    assert 0 < kept(database) < 600
    again = lab.quadctl(*words, "--db", database.name, "--report", "page.html")
    page = (lab.folder / "page.html").read_text()
    assert again.json["hash"] in page
    assert f"--replay {again.json['worst']['seed']}<" in page
    assert f" of 600 flights are in {database.name}" in again.err
    assert kept(database) == 600
    assert again.json == lab.quadctl(*words).json


@pytest.mark.thorough
def test_a_campaign_flies_the_given_parameters(lab: Lab):
    lab.file("[safety.virtual_cage]\nx = 0.5\ny = 1.0\n[pressure]\nnoise = 1.0\n", "own.toml")
    words = ("campaign", "--seconds", 2, "--config", "own.toml", "--set", "safety.takeoff=2")
    safety = lab.quadctl(*words, "--replay", 0, "--json").json["safety"]
    assert (safety["virtual_cage"]["x"], safety["virtual_cage"]["y"]) == (0.5, 1.0)
    assert safety["takeoff"] == 2
    for code, what in (
        (2, "pressure.noise=1"),
        (2, "dynamics.speed=2"),
        (6, "safety.takeof=1"),
        (6, "safety.takeoff=high"),
        (6, "dynamics.vehicle.mass=40"),
    ):
        assert lab.quadctl("campaign", "--set", what).code == code, what
    assert lab.quadctl("campaign", "--wind", 1, "--set", "dynamics.wind.gust=1").code == 2
    assert lab.quadctl("campaign", "--replay", 1, "--db", "x.sqlite").code == 2
    assert lab.quadctl("campaign", "--db", "own.toml").code == 6
    assert lab.quadctl("campaign", "--report", "none/page.html").code == 6


@pytest.mark.thorough
def test_ctrl_c_ends_a_campaign_and_all_its_workers(lab: Lab):
    flying = lab.spawn(*lab.command("campaign", "--flights", 1000, "--processes", 2))
    # The command, the campaign's own process, and at least one worker.
    eventually(lambda: len(lab.processes()) >= 3)
    flying.send(signal.SIGINT)
    assert flying.wait() == 130
    eventually(lambda: not lab.processes())


@pytest.mark.thorough
def test_a_search_writes_the_worst_flight_as_a_mission(lab: Lab):
    compiled_kernel()
    words = ("campaign", "--search", 60, "--flights", 300, "--seed", 1, "--seconds", 6, "--json")
    found = []
    for processes in (1, 2):
        done = lab.quadctl(*words, "--processes", processes)
        assert done.code == 0
        found.append(done.json["search"])
    files = [lab.folder / search.pop("mission") for search in found]
    assert [file.name for file in files] == ["worst_1.toml", "worst_1_1.toml"]
    assert found[0] == found[1]
    assert files[0].read_bytes() == files[1].read_bytes()
    assert (found[0]["evaluations"], found[0]["violations"]) == (300, [])
    assert 0.0 < found[0]["worst_excursion"] < found[0]["allowed"] == 0.01
    flown = lab.quadctl("fly", files[0].name, "--json")
    assert flown.code == 0
    assert flown.json["simulated_seconds"] == 6
    assert any(row["accepted"] for row in flown.json["rows"])


@pytest.mark.thorough
def test_a_search_that_breaks_a_promise_exits_8(lab: Lab):
    compiled_kernel()
    strict = (
        "campaign",
        "--search",
        60,
        "--flights",
        64,
        "--set",
        "safety.margin=0",
    )
    done = lab.quadctl(*strict)
    assert done.code == 8
    assert "VIOLATION    more than 0 m beyond the cage" in done.out
    assert done.out.endswith("again: quadctl fly worst_0.toml\n")


@pytest.mark.thorough
def test_ctrl_c_in_a_search_reports_the_worst_flight_so_far(lab: Lab):
    compiled_kernel()
    searching = lab.spawn(*lab.command("campaign", "--search", 600, "--seed", 4))
    eventually((lab.folder / "worst_4.toml").exists)
    searching.send(signal.SIGINT)
    assert searching.wait() == 130
    assert "again: quadctl fly worst_4.toml" in searching.log
    eventually(lambda: not lab.processes())


@pytest.mark.thorough
def test_an_impossible_campaign_is_a_usage_error(lab: Lab):
    for words in (
        "--seconds 0", "--flights 0", "--flights 2000000", "--seed -1", "--replay x", "--search 4",
        "--search 86401", "--search 9 --replay 1", "--search 9 --db x.sqlite",
    ):  # fmt: skip
        assert lab.quadctl("campaign", *words.split()).code == 2, words


def test_a_violation_exits_8_and_prints_the_command_to_replay_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], report: dict[str, Any]
):
    bad = report | {"violations": [{"seed": 3000001, "what": ["MOVING to a goal outside"]}]}
    monkeypatch.setattr(command, "_fly", lambda order, quiet: bad)
    with pytest.raises(SystemExit) as ended:
        command.campaign(options_of({}), faults=True, seconds=4.0)
    assert ended.value.code == 8
    said = capsys.readouterr().out
    assert "VIOLATION    seed 3000001: MOVING to a goal outside" in said
    assert "again: quadctl campaign --seconds 4 --faults --replay 3000001" in said


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(1200)
def test_ten_thousand_flights_stay_within_the_margin(module_lab: Lab, proofs: Proofs):
    compiled_kernel()
    for air, more, most in (
        ("still air", (), MARGIN),
        ("wind of 3 m/s with faults", ("--wind", 3, "--faults"), WINDY),
    ):
        words = ("campaign", "--flights", 10_000, "--seed", 1, *more, "--json")
        began = time.monotonic()
        done = module_lab.quadctl(*words, timeout=600.0)
        took = time.monotonic() - began
        proofs.add(
            f"10 000 flights of 60 s in {air}: worst excursion beyond the cage",
            f"{1000 * done.json['worst_excursion']:.3g} mm, {len(done.json['violations'])} violations,"
            f" in {took:.0f} s",
            f"{1000 * most:.0f} mm",
        )
        alarms = done.json["stops"].get("stopped, the path led out of the cage", 0)
        if not more:
            proofs.add("false alarms of the guard of the way in 10 000 flights", f"{alarms}", "0")
            assert alarms == 0
        assert done.code == 0, done.json["violations"]
        assert done.json["worst_excursion"] <= most


CAGES = (
    (0.2, 0.2, 0.2), (0.25, 0.25, 0.5), (0.5, 0.5, 1.0), (1.0, 1.0, 2.0), (2.5, 2.5, 5.0),
    (5.0, 5.0, 10.0), (20.0, 20.0, 20.0), (0.2, 5.0, 3.0), (5.0, 5.0, 0.5), (0.5, 0.5, 10.0),
    (5.0, 2.0, 1.5), (10.0, 0.3, 2.0),
)  # fmt: skip
"""Bounds of twelve cages, m: cubes, slits, a slab and a shaft among them."""


def searched(
    lab: Lab, size: tuple[float, ...], flights: int, seed: int, *more: object
) -> dict[str, Any]:
    """Return what a search in a cage (m) found, without any violation."""
    words = [f"safety.virtual_cage.{axis}={value}" for axis, value in zip("xyz", size, strict=True)]
    done = lab.quadctl(
        "campaign", "--search", 3600, "--flights", flights, "--seed", seed, "--json", *more,
        *sets(*words), timeout=3700.0,
    )  # fmt: skip
    assert done.code in {0, 8}, done.err
    found: dict[str, Any] = done.json["search"]
    assert not found["violations"], (size, found, (lab.folder / found["mission"]).read_text())
    return found


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(7200)
def test_a_search_finds_no_way_out_of_twelve_cages(lab: Lab, proofs: Proofs):
    compiled_kernel()
    # Not always the same flights: each run of the proof searches elsewhere.
    seed = int(time.time())
    worst: dict[tuple[float, ...], float] = {}
    for size in CAGES:
        worst[size] = searched(lab, size, 100_000, seed)["worst_excursion"]
    most = max(worst, key=lambda size: worst[size])
    proofs.add(
        "a search of 100 000 flights in each of twelve cages: worst excursion",
        f"{1000 * worst[most]:.3g} mm, in {most[0]:g} x {most[1]:g} x {most[2]:g} m (seed {seed})",
        "10 mm",
    )
    assert worst[most] <= MARGIN


WIND = 4.5
"""Speed of a wind (m/s) at the edge of the envelope, whose gusts have an RMS of a quarter of it."""


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(3600)
def test_a_search_in_wind_finds_no_way_beyond_the_margin(lab: Lab, proofs: Proofs):
    compiled_kernel()
    seed = int(time.time())
    worst = 0.0
    for size in CAGES:
        found = searched(lab, size, 10_000, seed, "--wind", WIND)
        worst = max(worst, found["worst_excursion"] / found["allowed"])
    proofs.add(
        f"a search of 10 000 flights in each of twelve cages in a wind of up to {WIND:g} m/s with"
        " gusts: worst excursion",
        f"{100 * worst:.0f} % of the margin (seed {seed})",
        "100 %",
    )
    assert worst <= 1


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(1800)
def test_the_memory_does_not_grow_with_the_flights(lab: Lab, proofs: Proofs):
    compiled_kernel()
    flying = lab.spawn(*lab.command("campaign", "--flights", 100_000, "--seed", 2))
    most: dict[bool, int] = {}

    def measured() -> bool:
        late = re.findall(r"^(\d+) of 100000", flying.log, re.MULTILINE)
        if late and int(late[-1]) > 5000:
            memory = sum(procfs.stats_of(pid).rss or 0 for pid in lab.processes())
            half = int(late[-1]) > 50_000
            most[half] = max(most.get(half, 0), memory)
        return flying.ended

    eventually(measured, 1500.0)
    assert flying.wait() == 0, flying.log
    growth = most[True] / most[False] - 1
    proofs.add(
        "memory of a campaign of 100 000 flights: growth from the first half to the second",
        f"{100 * growth:.1f} % of {most[False] / 1e6:.0f} MB",
        "less than 2 %",
    )
    assert growth < 0.02


@pytest.mark.thorough
def test_the_report_names_flights_excursion_and_transitions(report: dict[str, Any]):
    first, *rest = lines(report, 4.0, "quadctl campaign")
    assert first.startswith("6 flights of 4 s, worst excursion beyond the cage ")
    assert any(line.startswith("transitions") and "VERIFYING -> MOVING" in line for line in rest)


def test_a_campaigns_process_that_dies_in_a_line_is_an_error(monkeypatch: pytest.MonkeyPatch):
    half = 'import os; os.write(1, b\'{"flights": 1}\\n{"fli\'); os.kill(os.getpid(), 9)'
    monkeypatch.setattr(command, "_COMMAND", (sys.executable, "-c", half))
    with command.CampaignProcess({}) as process:
        progress = iter(process)
        assert next(progress) == {"flights": 1}
        with pytest.raises(QuadctlError, match="ended with code -9"):
            next(progress)
