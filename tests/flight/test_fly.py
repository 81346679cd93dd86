"""`fly`: a mission gives the same flight to the last bit, at any speed and under any load."""

import json
import os
import random
import re
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.support.compiled import compiled_vehicle
from tests.support.lab import Lab, private_lab
from tests.support.missions import MISSION, busy, fly, same, start
from tests.support.running import Foreground, eventually

SETTINGS = {
    "fast": ("dynamics.speed=0",),
    "ten": ("dynamics.speed=10",),
    "real": ("dynamics.lockstep=true",),
    "seed": ("dynamics.speed=10", "dynamics.seed=7"),
}


@pytest.fixture(scope="module")
def fast() -> Iterator[Lab]:
    """Lab at the highest speed (`dynamics.speed=0`), with the vehicle compiled."""
    compiled_vehicle()
    with private_lab() as made:
        start(made, *SETTINGS["fast"])
        eventually(lambda: "the vehicle flies compiled" in made.log("dynamics"))
        yield made


@pytest.fixture(scope="module")
def others() -> dict[str, dict[str, Any]]:
    """Results of the mission at the other speeds and with another seed, flown side by side."""
    with ExitStack() as stack, ThreadPoolExecutor(len(SETTINGS)) as pool:
        labs = {}
        for name in SETTINGS.keys() - {"fast"}:
            labs[name] = stack.enter_context(private_lab())
            start(labs[name], *SETTINGS[name])
        return dict(zip(labs, pool.map(fly, labs.values()), strict=True))


@pytest.fixture(scope="module")
def flights(others: dict[str, dict[str, Any]], fast: Lab) -> dict[str, dict[str, Any]]:
    """Results of the mission in each setting."""
    # The fast vehicle comes last, because it uses all the time of a processor, even at rest.
    return {**others, "fast": fly(fast)}


@pytest.mark.thorough
def test_a_flight_is_the_same_at_any_speed(flights: dict[str, dict[str, Any]]):
    fast = flights["fast"]
    # One vehicle in real time flies as plain Python.
    assert fast["counts"] == {"poses": 801, "transitions": 23, "pressure": 81}
    assert same(flights["ten"]) == same(fast)
    assert same(flights["real"]) == same(fast)
    assert [flights[name]["speed"] for name in ("fast", "ten", "real")] == [0, 10, 1]
    assert fast["simulated_seconds"] == 8
    assert flights["real"]["wall_seconds"] > 7.9


@pytest.mark.thorough
def test_each_row_of_a_mission_has_its_verdict(flights: dict[str, dict[str, Any]]):
    rows = flights["fast"]["rows"]
    assert [row["accepted"] for row in rows] == [
        True, True, True, False, True, False, True, True, True, True, True,
    ]  # fmt: skip
    assert rows[1]["baseline"] == pytest.approx(1013.13, abs=0.05)
    assert rows[3]["reason"].startswith("busy: flying to (2, 1, 1.5)")
    assert rows[5]["reason"] == "outside the cage: x = 9 is beyond [-5, 5]"
    assert (rows[4]["do"], rows[4]["at"], rows[4]["replace"]) == ("goto", 2.6, True)


@pytest.mark.thorough
def test_another_seed_gives_another_flight(flights: dict[str, dict[str, Any]]):
    fast, other = flights["fast"], flights["seed"]
    assert other["seed"] == 7
    # The seed changes only the barometer's noise so far.
    assert other["pressure"] != fast["pressure"]
    assert other["hash"] != fast["hash"]
    assert other["transitions"] == fast["transitions"]


@pytest.mark.thorough
def test_earlier_commands_do_not_change_a_mission(fast: Lab):
    first = fly(fast)
    assert fast.quadctl("cage", "off").code == 0
    assert fast.quadctl("goto", 7, 1, 2, "--no-wait", "--replace").code == 0
    assert fast.quadctl("calibrate").code == 0
    assert same(fly(fast)) == same(first)


def test_a_goal_requested_again_in_flight_does_not_change_with_the_load(fast: Lab):
    """Safety then sends two setpoints, and the vehicle may fly on between them."""
    again = '{ at = 0.5, do = "goto", x = 0.0, y = 0.0, z = 1.0 }'
    fast.file(f"rows = [{again}]\nend = 3.0", "again.toml")
    hashes = {fast.quadctl("fly", "again.toml", "--json").json["hash"] for _ in range(8)}
    assert len(hashes) == 1


def test_goals_on_the_walls_replaced_in_flight_keep_path_and_vehicle_inside(fast: Lab):
    draw, cage = random.Random(1), {"x": (-5, 5), "y": (-5, 5), "z": (0, 5)}
    goals = [{axis: float(draw.choice(sides)) for axis, sides in cage.items()} for _ in range(60)]
    rows = ",".join(
        "{{ at = {}, do = 'goto', replace = true, x = {x}, y = {y}, z = {z} }}".format(
            2.0 + n / 2, **goal
        )
        for n, goal in enumerate(goals)
    )
    fast.file(f"rows = [{rows}]\nend = 34.0", "walls.toml")
    with fast.bare() as bare:
        seen = [bare.watch("uav/pose"), bare.watch("uav/input/position")]
        flown = fast.quadctl("fly", "walls.toml", "--json")
        places = [each["position"] for watch in seen for each in watch.messages]
    assert flown.code == 0, flown.err
    assert all(row["accepted"] for row in flown.json["rows"])
    assert len(places) > 1000
    margin = 0.01
    assert [p for p in places for axis, (low, high) in cage.items()
            if not low - margin <= p[axis] <= high + margin] == []  # fmt: skip


def test_the_poses_of_a_quarter_second_come_as_one_message_that_no_wildcard_brings(fast: Lab):
    with fast.bare() as bare:
        batches, everything = bare.watch("uav/@all/pose"), bare.watch("uav/**")
        found = [[pose["seq"] for pose in batch["poses"]] for batch in batches.next(6)]
        everything.until(lambda message: message.get("for_seq", 0) > found[-1][-1])
        assert not [message for message in everything.messages if "poses" in message]
    assert max(map(len, found)) == 25
    # On a busy machine a pose that waits for its answer comes again.
    seen = sorted({seq for batch in found for seq in batch})
    assert seen == [*range(seen[0], seen[-1] + 1)]


def test_a_rate_lowered_between_two_answers_does_not_stop_the_clock(fast: Lab):
    fast.file(
        "end = 4.0\nrows = [{ at = 2.81, do = 'param', name = 'dynamics.rate', value = 25.0 },"
        " { at = 3.09, do = 'param', name = 'dynamics.rate', value = 50.0 }]",
        "rates.toml",
    )
    hashes = [fast.quadctl("fly", "rates.toml", "--json").json["hash"] for _ in range(2)]
    assert hashes[0] == hashes[1]


@pytest.mark.thorough
def test_a_mission_of_thousands_of_rows_flies_whole(fast: Lab):
    row = "{{ at = {}, do = 'goto', replace = true, x = {}, y = 0, z = 1 }}"
    rows = ",".join(row.format(2 + n / 20, n % 5 / 2) for n in range(3000))
    fast.file(f"rows = [{rows}]\nend = 153.0", "many.toml")
    flown = fast.quadctl("fly", "many.toml", "--json")
    assert flown.code == 0, flown.err
    assert [each for each in flown.json["rows"] if not each["accepted"]] == []


def test_fly_prints_rows_and_digests_as_text(fast: Lab):
    told = fast.quadctl("fly", "mission.toml")
    assert (told.code, told.err) == (0, "")
    assert re.search(
        r"^4\.80 s +goto 9 0 1 +rejected: outside the cage: x = 9", told.out, re.MULTILINE
    )
    assert re.search(r"^2\.00 s +calibrate +baseline 1013\.\d{4} hPa$", told.out, re.MULTILINE)
    digest = fly(fast)["poses"]
    assert re.search(rf"^poses +{digest} +of 801$", told.out, re.MULTILINE)


def test_an_invalid_mission_is_reported_by_row_before_the_flight(lab: Lab):
    lab.file('rows = [{ at = 1.0, do = "goto", x = 1.0, y = 2.0 }]', "mission.toml")
    wrong = lab.quadctl("fly", "mission.toml", "--json")
    assert (wrong.code, wrong.out) == (6, "")
    assert wrong.error["message"] == "mission.toml: row 1: object missing required field z"
    wrong = lab.quadctl("fly", "misson.toml")
    assert wrong.code == 6
    assert "misson.toml cannot be read: No such file or directory" in wrong.err
    assert "did you mean mission.toml?" in wrong.err
    lab.file('rows = [{ at = 1.0, do = "hold" }]', "mission.toml")
    assert lab.quadctl("fly", "mission.toml").code == 3


@pytest.mark.thorough
def test_a_missing_service_is_reported_before_the_flight(lab: Lab):
    example = Path(__file__).parents[2] / "examples" / "my_safety.py"
    command = f'[processes]\nsafety = ["python", "{example}"]\n'
    lab.start(lab.file(command), "--set", "dynamics.start.z=1")
    lab.file('rows = [{ at = 1.0, do = "cage", on = true }]', "mission.toml")
    done = lab.quadctl("fly", "mission.toml", "--timeout", 1)
    assert done.code == 3
    assert "nobody served uav/@srv/toggle_cage within 1 s" in done.err
    done = lab.quadctl("cage", "off", "--timeout", 0.5)
    assert (done.code, done.err) == (
        3,
        (
            "error: nobody served uav/@srv/toggle_cage within 0.5 s: safety does not offer toggle_cage\n"
            "  try: add it to your own node, or use ours: see [processes] in quad.toml\n"
        ),
    )
    done = lab.quadctl("calibrate", "--timeout", 0.5)
    assert done.code == 0  # pressure offers it


EXAMPLE = (Path(__file__).parents[2] / "examples" / "my_safety.py").read_text(encoding="utf-8")
LOOP = "    for seen in node.poses():\n"
STYLES = {
    "poses": EXAMPLE,
    "sleeps": EXAMPLE.replace(LOOP, f"    import time\n{LOOP}        time.sleep(0.002)\n"),
    "ticks": EXAMPLE.replace(
        LOOP,
        "    poses = node.listen(POSE)\n    for _ in node.ticks(20):\n"
        "        seen = poses.value\n        assert seen is not None\n",
    ),
    "spin": EXAMPLE.replace(
        LOOP,
        "    def on_pose(seen: Pose) -> None:\n        nonlocal pose, state, goal, count, reason\n",
    ).replace("\n\nstart(", "    node.listen(POSE_SLOW, on_pose)\n    node.spin()\n\n\nstart("),
}
"""The same safety node in each documented style."""


def test_a_loop_that_sleeps_answers_its_calls(lab: Lab):
    (lab.folder / "mine.py").write_text(
        STYLES["sleeps"].replace("sleep(0.002)", "sleep(1 / 20)"), encoding="utf-8"
    )
    lab.start(lab.file('[processes]\nsafety = "python mine.py"\n'), "--set", "dynamics.start.z=1")
    for x in (1, 9, 2):
        assert lab.quadctl("goto", x, 0, 1).code == (5 if x == 9 else 0)


BATTERY = """
import time
from collections import deque
from msgspec import Struct
from quadctl import Node, Params, Service, start
from quadctl.schemas.topics import POSE_SLOW

class ChargeRequest(Struct):
    volts: float

class ChargeResponse(Struct):
    success: bool
    volts: float
    reason: str = ""

CHARGE = Service("own/charge", ChargeRequest, ChargeResponse, node="own-battery", doc="Charges.")

def charge(request):
    ok = request.volts < 13
    return ChargeResponse(ok, request.volts, "" if ok else "too much")

def run(node: Node, params: Params) -> None:
    poses = deque()
    node.serve(CHARGE, charge)
    node.listen(POSE_SLOW, poses.append)
    node.ready()
    while not node.stopping:
        if node.wait_for(lambda: bool(poses), 1.0):
            poses.popleft()
            time.sleep(0.001)  # longer than a pose takes at this speed

start("own-battery", run)
"""


@pytest.mark.thorough
def test_a_mission_calls_a_service_of_ones_own_by_name_and_by_type(lab: Lab):
    lab.file(BATTERY, "battery.py")
    config = lab.file('[processes]\nown-battery = "python battery.py"\n')
    lab.start(config, "--set", "dynamics.speed=0")
    rows = (
        '{ at = 1.0, do = "call", service = "own/charge", request = { volts = 12.5 } }',
        '{ at = 1.5, do = "call", service = "Charge", request = { volts = 20 } }',
    )
    mission = lab.file(f"end = 2.0\nrows = [{', '.join(rows)}]", "mission.toml")
    done = lab.quadctl("fly", mission)
    assert done.code == 0, done.err
    assert done.out.splitlines()[:2] == [
        "1.00 s  call own/charge volts=12.5  success true, volts 12.5",
        "1.50 s  call Charge volts=20        rejected: too much",
    ]
    lab.file('rows = [{ at = 1.0, do = "call", service = "Charg" }]', "mission.toml")
    done = lab.quadctl("fly", mission)
    assert (done.code, done.err) == (
        6,
        "error: there is no service of the type Charg\n  try: did you mean Charge?\n",
    )


def test_a_node_in_any_style_flies_the_same_mission(lab: Lab):
    mission = lab.file(
        """end = 5.0
        set = { dynamics.start.z = 1 }
        rows = [{ at = 1.0, do = "goto", x = 1.5, y = 0.0, z = 1.0 },
                { at = 1.5, do = "goto", x = 9.0, y = 0.0, z = 1.0 }]""",
        "mission.toml",
    )
    lab.file('[processes]\nsafety = "python mine.py"\n')
    flown = {}
    for style, source in STYLES.items():
        imports = "import GOTO, POSE, POSE_SLOW,"
        (lab.folder / "mine.py").write_text(
            source.replace("import GOTO,", imports), encoding="utf-8"
        )
        done = lab.quadctl("fly", mission, "--json")
        assert done.code == 0, (style, done.err)
        flown[style] = same(done.json)["poses"]
    assert len(set(flown.values())) == 1, flown


PARAMS = """
end = 6.0
rows = [
    { at = 1.0, do = "goto", x = 1.5, y = 0.0, z = 1.0 },
    { at = 1.2, do = "param", name = "dynamics.control.max_speed", value = 1.0 },
    { at = 2.0, do = "param", name = "safety.virtual_cage.x", value = 1.0 },
    { at = 2.5, do = "param", name = "dynamics.rate", value = 30 },
    { at = 3.0, do = "param", name = "pressure", value = { rate = 25, fault = { kind = "off" } } },
    { at = 4.0, do = "param", name = "pressure.fault.kind", value = "delay" },
]
"""
"""Changes of parameters: at once, from a standstill, refused, and of the barometer's readings."""


@pytest.mark.thorough
def test_rows_set_parameters_for_one_flight(fast: Lab):
    fast.file(PARAMS, "params.toml")
    before = fast.quadctl("param", "dump").out
    first, again = (fast.quadctl("fly", "params.toml", "--json").json for _ in range(2))
    assert same(again) == same(first)
    assert fast.quadctl("param", "dump").out == before
    _, waits, cage, refused, *others = first["rows"]
    assert (waits["accepted"], waits["reason"]) == (True, "from the next standstill")
    assert (cage["value"], cage["accepted"], cage["reason"]) == (1.0, True, "")
    assert not refused["accepted"]
    assert refused["reason"].startswith("dynamics: rate 30.0 Hz: 1000 / rate must be a whole")
    assert [row["accepted"] for row in others] == [True, True]
    # 10 Hz to 3 s, then none, and from 5 s on those of 1 s before, at 25 Hz.
    assert first["counts"]["pressure"] == 31 + 50
    told = fast.quadctl("fly", "params.toml").out
    assert re.search(
        r"^1\.20 s +param set dynamics\.control\.max_speed 1\.0 +accepted, from the next standstill$",
        told,
        re.MULTILINE,
    )


@pytest.mark.thorough
def test_settings_fly_in_a_run_of_their_own(lab: Lab, fast: Lab):
    own = lab.file(f"{MISSION}\n[set]\n", "mission.toml")
    assert same(fly(lab)) == same(fly(fast))
    own.write_text(f"{PARAMS}\n[set]\n'safety.virtual_cage.x' = 1.2\n", encoding="utf-8")
    first = lab.quadctl("fly", "mission.toml", "--json")
    assert first.err == "mission.toml has [set]: it flies in a run of its own\n"
    assert first.json["rows"][0]["reason"] == "outside the cage: x = 1.5 is beyond [-1.2, 1.2]"
    with own.open("a", encoding="utf-8") as text:
        text.write("dynamics.speed = 10\n")
    assert same(fly(lab)) == same(first.json)
    assert lab.is_gone()


@pytest.mark.thorough
def test_beside_a_run_in_real_time_a_mission_flies_in_a_run_of_its_own(lab: Lab, fast: Lab):
    start(lab, "safety.virtual_cage.x=1.2")
    with lab.bare() as bare:
        before = bare.state()
        first = lab.quadctl("fly", "mission.toml", "--json")
        assert (first.code, before["boot"]) == (0, bare.state()["boot"])
    assert first.err == (
        f"the realm {lab.realm} is in real time: the mission flies in a run of its own,"
        " in lock-step, with the parameters of uav\n"
    )
    assert first.json["rows"][2]["reason"] == "outside the cage: x = 2 is beyond [-1.2, 1.2]"
    assert lab.quadctl("param", "set", "safety.virtual_cage.x", 5).code == 0
    assert same(fly(lab)) == same(fly(fast))
    refused = lab.quadctl(
        "fly", "mission.toml", "--connect", f"unixsock-stream/{lab.home}/hub.sock"
    )
    assert refused.code == 5
    assert "in real time, and missions fly in lock-step" in refused.err
    assert "dynamics.lockstep=true" in refused.err


@pytest.mark.thorough
def test_a_run_in_lock_step_says_so(fast: Lab):
    assert fast.status()["lockstep"]
    assert (
        fast.quadctl("status")
        .out.splitlines()[0]
        .startswith(f"realm {fast.realm}, vehicle uav, in lock-step, supervised by process ")
    )
    checks = {check["name"]: check for check in fast.quadctl("doctor", "--json").json["checks"]}
    assert checks["time"]["evidence"] == "lock-step, at speed 0: the clock waits for safety"
    wrong = fast.quadctl("param", "set", "dynamics.lockstep", "false")
    assert "fixed at launch" in wrong.err


def test_wrong_settings_start_no_run(lab: Lab):
    own = lab.file(f"{MISSION}\n[set]\n", "mission.toml")
    for words in (("--realm", lab.realm), ("--connect", "tcp/127.0.0.1:1")):
        assert lab.quadctl("fly", "mission.toml", *words).code == 2
    own.write_text(f"{MISSION}\n[set]\nsafety.takeof = 1\n", encoding="utf-8")
    wrong = lab.quadctl("fly", "mission.toml", "--json")
    assert wrong.code == 6
    assert wrong.error["message"] == "mission.toml: [set]: unknown parameter safety.takeof"
    assert not [*lab.runtime.glob("quadctl/*")]


@pytest.mark.thorough
@pytest.mark.parametrize(("victim", "code"), [("fly", 130), ("safety", 3)])
def test_a_run_of_its_own_ends_with_its_mission(lab: Lab, victim: str, code: int):
    lab.file(f"{LONG}\n[set]\ndynamics.speed = 10\n", "long.toml")
    flying = in_flight(lab, "long.toml")
    if victim == "fly":
        flying.send(signal.SIGINT)
    else:
        lab.signal(victim, signal.SIGKILL)
    assert flying.wait() == code, flying.log
    eventually(lab.is_gone)


@pytest.mark.thorough
def test_a_run_of_its_own_waits_for_a_frozen_process(lab: Lab, fast: Lab):
    lab.file(f"{MISSION}\n[set]\ndynamics.speed = 2\n", "mission.toml")
    flying = in_flight(lab, "mission.toml", "--json")
    nodes = lab.nodes()
    # Longer than the lease of a link and the timeout of a health ping in other runs.
    for pid in (nodes["hub"]["pid"], nodes["dynamics"]["pid"], flying.pid):
        os.kill(pid, signal.SIGSTOP)
        time.sleep(2.5)
        os.kill(pid, signal.SIGCONT)
    assert flying.wait() == 0, flying.log
    flown = json.loads(flying.log.splitlines()[-1])
    assert flown["wall_seconds"] > 2.5
    assert same(flown) == same(fly(fast))


def in_flight(lab: Lab, *words: str) -> Foreground:
    """Fly a mission in a run of its own, which becomes the lab's; return when it is on its way."""
    flying = lab.spawn(*lab.command("fly", *words))
    [record] = eventually(lambda: [*lab.runtime.glob("quadctl/fly-*/run.json")])
    lab.realm = record.parent.name
    # The second boot is the mission's: a process that is stopped in the first delays only its start.
    [boot] = eventually(lambda: re.findall(r"^boot (\w+)$", lab.log("dynamics"), re.MULTILINE)[1:2])
    with lab.first_bare() as bare:
        bare.watch("uav/pose").until(lambda p: p["boot"] == boot and p["stamp"] > 1)
    return flying


LONG = 'end = 3600.0\nrows = [{ at = 3000.0, do = "goto", x = 1.0, y = 2.0, z = 1.0 }]'


@pytest.mark.thorough
@pytest.mark.parametrize("node", ["dynamics", "pressure", "safety"])
def test_a_node_death_voids_the_flight_and_the_next_is_complete(fast: Lab, node: str):
    fast.file(LONG, "long.toml")
    usual = fly(fast)
    with fast.bare() as bare:
        poses = bare.watch("uav/pose")
        before = poses.next()[0]["boot"]
        flying = fast.spawn(*fast.command("fly", "long.toml", "--json"))
        boot = poses.until(lambda p: p["boot"] != before)["boot"]
        poses.until(lambda p: p["boot"] == boot and p["stamp"] > 1)
        old = fast.signal(node, signal.SIGKILL)
        assert flying.wait() in {1, 3, 4}
        fast.revived(node, old)
    assert '"error"' in flying.log
    assert same(fly(fast)) == same(usual)


def test_ctrl_c_drops_a_mission(fast: Lab):
    fast.file(LONG, "long.toml")
    with fast.bare() as bare:
        poses = bare.watch("uav/pose")
        before = poses.next()[0]["boot"]
        flying = fast.spawn(*fast.command("fly", "long.toml"))
        boot = poses.until(lambda p: p["boot"] != before)["boot"]
        flying.send(signal.SIGINT)
        assert flying.wait() == 130
        assert "the mission is dropped: the vehicle is back at its start" in flying.log
        eventually(lambda: bare.state()["boot"] not in {before, boot})


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", ["fast", "ten", "real"])
def test_a_flight_is_the_same_under_any_load(lab: Lab, fast: Lab, name: str):
    expected = same(fly(fast))
    start(lab, *SETTINGS[name])
    for loops in (0, 8):
        with busy(loops):
            assert [same(fly(lab, timeout=250)) for _ in range(3)] == [expected] * 3
