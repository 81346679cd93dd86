"""Vehicles of one run keep apart: refusals, goals that wait, and plans of a fleet's flights."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tests.support.lab import PATIENT, Lab, private_lab
from tests.support.proofs import Proofs
from tests.support.running import eventually

START = """
[uav0.dynamics.start]
x = -1.0
[uav1.dynamics.start]
x = 1.0
[uav2.dynamics.start]
x = 3.0
y = 2.0
"""


@pytest.fixture(scope="module")
def three() -> Iterator[Lab]:
    """Three vehicles in real time, as they stand in START."""
    with private_lab() as made:
        (made.folder / "quad.toml").write_text(START)
        made.share("--vehicles", 3, *PATIENT)
        yield made


@pytest.fixture
def home(three: Lab) -> Lab:
    """The three vehicles at rest above their starts."""
    three.put_back()
    done = three.quadctl("fleet", "goto", "uav0=-1,0,1", "uav1=1,0,1", "uav2=3,2,1")
    assert done.code == 0, done.err
    return three


@pytest.mark.thorough
def test_a_goal_past_another_vehicle_is_refused_with_its_name(home: Lab):
    done = home.quadctl("goto", 3, 0, 1, "--vehicle", "uav0", "--json")
    assert done.code == 5
    assert done.json["reason"].startswith("separation: uav1 ")
    assert "--wait" in done.error["hint"]
    # The cage, off, lets it nowhere near either.
    assert home.quadctl("cage", "off", "--vehicle", "uav0").code == 0
    assert home.quadctl("goto", 3, 0, 1, "--vehicle", "uav0").code == 5
    assert home.quadctl("cage", "on", "--vehicle", "uav0").code == 0


@pytest.mark.thorough
def test_a_goal_waits_until_the_other_has_passed(home: Lab):
    crossing = home.quadctl("goto", 1, 3, 1, "--vehicle", "uav1", "--no-wait")
    assert crossing.code == 0
    done = home.quadctl("goto", 1, 1, 1, "--vehicle", "uav0", "--wait")
    assert done.code == 0, done.err
    assert done.out.splitlines()[0] == "accepted"
    assert "arrived" in done.out


@contextmanager
def crawling(lab: Lab, vehicle: str) -> Iterator[None]:
    """Let a vehicle fly so slowly that it is in the way for the whole test."""
    name = f"{vehicle}.dynamics.control.max_speed"
    assert lab.quadctl("param", "set", name, 0.1).code == 0
    try:
        yield
    finally:
        assert lab.quadctl("hold", "--vehicle", vehicle).code == 0
        assert lab.quadctl("param", "set", name, 5.0).code == 0


def test_hold_drops_a_goal_that_waits(home: Lab):
    with crawling(home, "uav1"), home.bare() as bare:
        assert home.quadctl("goto", -1, 2, 1, "--vehicle", "uav1", "--no-wait").code == 0
        states = bare.watch("uav0/safety/state")
        waits = home.spawn(*home.command("goto", 0, 3, 1, "--vehicle", "uav0", "--wait"))
        states.until(lambda s: s["reason"].startswith("waits: separation: uav1"))
        assert home.quadctl("hold", "--vehicle", "uav0").code == 0
        assert waits.wait() == 5
        assert "hold: stopped on request" in waits.log


@pytest.mark.thorough
def test_ctrl_c_ends_the_command_and_the_goal_still_waits(home: Lab):
    with crawling(home, "uav1"), home.bare() as bare:
        assert home.quadctl("goto", -1, 2, 1, "--vehicle", "uav1", "--no-wait").code == 0
        states = bare.watch("uav0/safety/state")
        waits = home.spawn(*home.command("goto", 0, 3, 1, "--vehicle", "uav0", "--wait"))
        states.until(lambda s: s["reason"].startswith("waits: separation: uav1"))
        waits.send(signal.SIGINT)
        assert waits.wait() == 130
        # The one in the way is stopped elsewhere: the goal is flown to, or refused.
        assert home.quadctl("hold", "--vehicle", "uav1").code == 0
        states.until(lambda s: not s["reason"].startswith("waits"))


def test_three_change_places_by_one_command(home: Lab):
    done = home.quadctl("fleet", "goto", "uav0=1,0,1", "uav1=-1,0,1", "uav2=3,2,1.5")
    assert done.code == 0, done.err
    assert done.err.startswith("to keep apart, ")
    assert least(done.out) >= 1


@pytest.mark.thorough
def test_three_change_places_while_they_take_off(lab: Lab):
    lab.start("--vehicles", 3, *PATIENT)
    done = lab.quadctl("fleet", "goto", "uav0=4,0,1", "uav1=0,0,1", "uav2=2,0,1")
    assert done.code == 0, done.err
    assert least(done.out) >= 1


@pytest.mark.thorough
def test_a_plan_with_points_between_has_to_be_followed(home: Lab):
    words = ("fleet", "goto", "uav0=1,0,1", "uav1=-1,0,1", "--no-wait")
    done = home.quadctl(*words)
    assert (done.code, "leave out --no-wait" in done.err) == (2, True)
    shown = home.quadctl("fleet", "list", "--json").json
    assert [row["goal"]["x"] for row in shown] == [-1.0, 1.0, 3.0]


def test_goals_too_near_each_other_move_nobody(home: Lab):
    done = home.quadctl("fleet", "goto", "uav0=0,2,1", "uav1=0.3,2,1")
    assert done.code == 5
    assert "separation: the goal of uav0 is too near the goal of uav1" in done.err
    shown = home.quadctl("fleet", "list", "--json").json
    assert [row["goal"]["x"] for row in shown] == [-1.0, 1.0, 3.0]


@pytest.mark.thorough
def test_the_distance_is_a_parameter(home: Lab):
    for name in ("uav0", "uav1", "uav2"):
        assert home.quadctl("param", "set", f"{name}.safety.separation.radius", 0).code == 0
    try:
        assert home.quadctl("goto", 0.8, 0, 1, "--vehicle", "uav0").code == 0
        assert home.quadctl("goto", -1, 0, 1, "--vehicle", "uav0").code == 0
    finally:
        for name in ("uav0", "uav1", "uav2"):
            assert home.quadctl("param", "set", f"{name}.safety.separation.radius", 0.3).code == 0


FIFTY = [(round(0.8 * (n % 10) - 3.6, 1), round(0.8 * (n // 10) - 1.6, 1)) for n in range(50)]


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(600)
def test_fifty_change_places_by_one_command(lab: Lab, proofs: Proofs):
    starts = (f"[uav{n}.dynamics.start]\nx = {x}\ny = {y}\n" for n, (x, y) in enumerate(FIFTY))
    (lab.folder / "quad.toml").write_text("".join(starts))
    lab.start("--vehicles", 50)
    eventually(
        lambda: all(
            row["state"] == "HOVERING" and row["goal"]["z"] == 1
            for row in lab.quadctl("fleet", "list", "--json").json
        ),
        60,
    )
    goals = [f"uav{n}={x},{y},1" for n, (x, y) in enumerate(reversed(FIFTY))]
    done = lab.quadctl("fleet", "goto", *goals, timeout=300)
    assert done.code == 0, done.err
    share = least(done.out)
    flown = sum("arrived within" in line for line in done.out.splitlines())
    proofs.add(
        "least distance of two vehicles, 50 that change places by one `fleet goto`",
        f"{share:.2f} of what they keep; {flown} of 50 arrived", "at least 1; all arrive",
    )  # fmt: skip
    assert flown == 50
    assert share >= 1


@pytest.mark.thorough
def test_vehicles_in_flight_change_course_past_each_other(home: Lab):
    # The ways of vehicles in motion bend: these come to rest first.
    goals = ("uav0=-1,-2,1", "uav1=1,2,1")
    assert home.quadctl("fleet", "goto", *goals, "--no-wait").code == 0
    # Wherever they are by then, the straight ways cross.
    done = home.quadctl("fleet", "goto", "uav0=1,2,1", "uav1=-1,0.5,1", "--replace")
    assert done.code == 0, done.err
    assert least(done.out) >= 1


def least(printed: str) -> float:
    """Return the least distance of two vehicles, as a share of what they keep."""
    last = printed.splitlines()[-1]
    assert last.startswith("least distance: "), printed
    return float(last.split(" m, ")[1].split()[0])
