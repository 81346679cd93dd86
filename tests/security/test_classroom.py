"""Thirty students on one network, each with his own machine, cannot disturb each other."""

import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from tests.support.bare import Bare, gap
from tests.support.classroom import (
    AT,
    BACK,
    COUNT,
    HERE,
    HZ,
    SHARED,
    Ear,
    Room,
    Student,
    classroom,
    side_by_side,
)
from tests.support.intruder import sent
from tests.support.proofs import Proofs
from tests.support.running import Done, eventually

pytestmark = [pytest.mark.prove, pytest.mark.alone]

ARENA = "tls/10.7.1.1:7448"
SETPOINT = ("boot=x", "for_seq=1", "position.x=9", "position.y=9", "position.z=9", "brake=false")
DENIED = (
    ("cage", "off"),
    ("cage", "off", "--vehicle", "uav8"),
    ("hold", "--vehicle", "uav8"),
    ("goto", "0", "0", "1", "--vehicle", "uav8"),
    ("topic", "pub", "input/position", *SETPOINT),
    ("topic", "pub", "input/position", *SETPOINT, "--vehicle", "uav8"),
)
"""Commands that the student of uav7 may not run."""


@pytest.fixture(scope="module")
def arena() -> Iterator[Room]:
    """Classroom with all vehicles up on the teacher's machine, and a folder given to each student."""
    with classroom(COUNT) as room:
        for line in ("keys init", "keys issue hub teacher --host 10.7.1.1 --host 10.7.2.1"):
            assert room.do(line).code == 0
        # The page's `keys issue student anna --vehicle uav0`, for all at once.
        assert room.teacher.quadctl("keys", "issue", "student", "--vehicles", COUNT).code == 0
        room.teacher.start(
            *("--vehicles", COUNT, "--listen", "tls/0.0.0.0:7448"),
            *("--identity", "keys/teacher", *SHARED),
            *("--set", "safety.separation.radius=0"),  # all fly to one point
        )
        for student in room.students:
            student.copy_keys(room.keys)
        yield room


def at_teacher(student: Student, *words: object) -> Done:
    """Run a student's command against the teacher's machine."""
    return student.say(*words, "--connect", ARENA, "--identity", "uav7")


def touched(room: Room, bare: Bare, calls: Ear) -> dict[str, tuple[Any, ...]]:
    """Return, for each vehicle, the values that change with every call to it."""
    states = {s.name: bare.latest(f"{s.name}/safety/state") for s in room.students}
    return {
        name: (state["request"], state["cage_on"], state["boot"], len(calls.calls[name]))
        for name, state in states.items()
    }


def test_a_student_flies_only_his_vehicle_and_toggles_no_cage(arena: Room, proofs: Proofs):
    with arena.teacher.bare() as bare:
        calls = Ear(bare, "*/@call/**")
        before = touched(arena, bare, calls)
        flown = side_by_side(lambda s: at_teacher(s, "goto", 1, 1, 1), arena.students)
        assert [done for done in flown if done.code] == []
        eventually(lambda: all(len(calls.calls[name]) == 1 for name in before))
        flown_to = touched(arena, bare, calls)
        assert flown_to == {
            name: (request + 1, cage_on, boot, 1)
            for name, (request, cage_on, boot, _) in before.items()
        }
        tried = side_by_side(lambda s: [at_teacher(s, *words) for words in DENIED], arena.students)
        for student, tries in zip(arena.students, tried, strict=True):
            for done in tries:
                assert done.code == 3, (student.name, done)
                assert f"not allowed: a student of {student.name} may not" in done.err

        def intrudes(student: Student) -> list[dict[str, list[str]]]:
            identity = student.lab.folder / student.name
            enter = student.port.machine.enter
            return [sent(enter, ARENA, identity, student.neighbour)]

        for student, intrusions in zip(
            arena.students, side_by_side(intrudes, arena.students), strict=True
        ):
            own = f"{student.name}/"
            for got in intrusions:
                assert [key for key in got["heard"] if not key.startswith(own)] == []
                assert got["asked"] == []
        assert touched(arena, bare, calls) == flown_to
    proofs.add(
        f"{HERE}, their vehicles on the teacher's: each student at his own cage and his neighbour's,"
        " and at his neighbour's vehicle, by commands and by Zenoh alone: what was executed",
        f"0 of {COUNT * len(DENIED)} commands",
        "nothing",
    )


ARRIVED = 0.5
"""m from its goal, at most, for a vehicle that has arrived."""
LANDED = 0.05
"""m above the ground, at most, for a vehicle that has landed."""
STILL = 0.05
"""m from its place, at most, for a hovering vehicle."""
STALL = 1.0
"""Seconds without a pose at home that thirty vehicles on two cores may cause. A restarted process or
link takes longer."""
REVOKED = 2.0
"""Seconds within which a revoked name is out."""
SILENT = 2.0
"""Seconds that the gate may take to let all students' machines in again with a new list of names."""
LONG = 5.0
"""Seconds that a cable is unplugged."""
EVERYWHERE = {"hub", "gate"}
"""Nodes that are visible to all students."""


def goals(room: Room, side: float) -> dict[str, dict[str, float]]:
    """Return a different goal for each student."""
    return {
        student.name: {"x": side * (1.5 + n / 10), "y": -4.0 + n / 4, "z": 1.0 + n / 20}
        for n, student in enumerate(room.students)
    }


def assert_undisturbed(room: Room, boots: dict[str, str], since: float) -> float:
    """Assert that no vehicle was disturbed; return the longest time without a pose at home, s."""
    assert {s.name: s.restarts() for s in room.students} == dict.fromkeys(boots, 0)
    assert {s.name: s.ear.boots[s.name] for s in room.students} == {
        n: {b} for n, b in boots.items()
    }
    longest = max(student.ear.gaps(student.name, since) for student in room.students)
    assert longest < STALL
    return longest


def boots_of(room: Room) -> dict[str, str]:
    return {student.name: student.state()["boot"] for student in room.students}


def test_all_vehicles_are_listed_and_their_poses_keep_their_rates(room: Room, proofs: Proofs):
    rows = room.listed()
    assert list(rows) == [student.name for student in room.students]
    assert {(row["cage_on"], row["error"]) for row in rows.values()} == {(True, None)}
    # A machine without listening sockets cannot be reached.
    assert [student.port.machine.sockets() for student in room.students] == [[]] * COUNT
    began = time.monotonic()
    time.sleep(10.0)
    own = [student.ear.rate(student.name, began) for student in room.students]
    far = [room.ear.rate(student.name, began) for student in room.students]
    proofs.add(
        f"{HERE}: poses of {HZ} Hz",
        f"{min(own):.1f} to {max(own):.1f} Hz at home, {min(far):.1f} to {max(far):.1f} Hz at the"
        " teacher's",
        f"{HZ} Hz",
    )
    assert min(own + far) > 0.95 * HZ


def test_one_vehicle_flies_and_no_other_moves(room: Room):
    flier, *others = room.students
    before = {student.name: student.at() for student in others}
    done = flier.do("goto 1 2 1")
    assert done.code == 0, done.err
    assert done.out.startswith("accepted\narrived within "), done.out
    for student in others:
        assert gap(student.at(), before[student.name]) < STILL


def test_all_vehicles_fly_at_once_each_to_its_own_goal(room: Room):
    wanted, before = goals(room, 1.0), {s.name: s.touched() for s in room.students}
    for student in room.students:
        student.goto(wanted[student.name])
    room.rests()
    for student in room.students:
        goal, (request, *same, calls) = wanted[student.name], before[student.name]
        assert student.state()["goal"] == goal
        assert student.state()["reason"] == ""
        assert gap(student.at(), goal) < ARRIVED
        assert gap(room.ear.pose[student.name]["position"], goal) < ARRIVED
        assert student.touched() == (request + 1, *same, calls + 1)
        assert student.ear.calls[student.name][-1] == goal | {
            "replace": False,
            "direct": False,
            "wait": False,
        }


TRIED = (
    ("hold",),
    ("goto", "0", "0", "1"),
    ("cage", "off"),
    ("topic", "pub", "input/position", "boot=x", "for_seq=1", "position.x=9", "position.y=9",
     "position.z=9", "brake=false"),
)  # fmt: skip
"""Commands tried on the neighbour's vehicle."""


def test_no_student_reaches_his_neighbours_vehicle(room: Room, proofs: Proofs):
    before = {student.name: student.touched() for student in room.students}
    places = {student.name: student.at() for student in room.students}

    def tries(student: Student) -> list[int]:
        return [student.say(*one, "--vehicle", "uav8", "--timeout", 4).code for one in TRIED]

    assert room.students[0].do("hold --vehicle uav8 --timeout 0.5").code == 3
    assert side_by_side(tries, room.students) == [[3] * len(TRIED)] * COUNT

    # Each student subscribes to everything, which would include his neighbour's messages.
    ears = {student.name: Ear(student.bare, "**", "*/@call/**") for student in room.students}

    def intrudes(student: Student) -> dict[str, list[str]]:
        identity = student.lab.folder / student.name
        return sent(student.port.machine.enter, AT, identity, student.neighbour)

    try:
        intruded = side_by_side(intrudes, room.students)
    finally:
        for ear in ears.values():
            ear.close()
    for student, got in zip(room.students, intruded, strict=True):
        own = f"{student.name}/"
        assert {key for key in got["heard"] if not key.startswith(own)} == set()
        # An error is Zenoh's own reply to a query without an answer.
        replied = {key for key in got["replied"] if not key.startswith((own, "error from "))}
        assert replied <= {f"{other.name}/info" for other in room.students}
        assert {key for key in got["asked"] if not key.startswith(own)} == set()
        seen = [key.split("/") for key in got["seen"] if not key.startswith(own)]
        assert {"/".join(words[2:]) for words in seen} <= EVERYWHERE
    received = sum(n for ear in ears.values() for n in ear.count.values())
    others = sum(n for name, ear in ears.items() for of, n in ear.count.items() if of != name)
    proofs.add(
        f"{HERE}, each at his neighbour's vehicle, by commands and by Zenoh alone: what was executed,"
        " and what any has heard of another's",
        f"0 of {COUNT * len(TRIED)} commands; {others} of {received} messages",
        "nothing",
    )
    assert others == 0
    assert {student.name: student.touched() for student in room.students} == before
    for student in room.students:
        assert gap(student.at(), places[student.name]) < STILL


def test_the_teacher_stops_and_lands_all_vehicles(room: Room, proofs: Proofs):
    for student in room.students:
        student.goto(goals(room, -1.0)[student.name])
    began = time.monotonic()
    done = room.teacher.quadctl("fleet", "hold", timeout=60.0)
    told = time.monotonic() - began
    assert (done.code, len(done.out.splitlines())) == (0, COUNT), done
    room.rests()
    stopped = time.monotonic() - began
    began = time.monotonic()
    done = room.teacher.quadctl("fleet", "land-all", timeout=60.0)
    landed = time.monotonic() - began
    assert (done.code, len(done.out.splitlines())) == (0, COUNT), done
    assert max(student.at()["z"] for student in room.students) < LANDED
    proofs.add(
        f"{HERE}, in flight: `fleet hold` until the last is told, and hovers; `fleet land-all` until"
        " the last has landed",
        f"{told:.1f} s, {stopped:.1f} s; {landed:.1f} s",
        "all",
    )


def test_an_unplugged_cable_disturbs_no_other_student(room: Room, proofs: Proofs):
    boots = boots_of(room)
    gaps, back, away = [], [], []
    for cut in (room.students[3:4], room.students[::3]):
        began = time.monotonic()
        with ExitStack() as cables:
            for student in cut:
                cables.enter_context(student.port.unplugged())
            time.sleep(LONG)
            # The vehicle flies on at the student's own machine.
            gaps.append(assert_undisturbed(room, boots, began))
        mended = time.monotonic()
        room.hears(cut, mended)
        back.append(time.monotonic() - mended)
        names = {student.name for student in cut}
        away += [room.ear.gaps(s.name, began) for s in room.students if s.name not in names]
        gaps.append(assert_undisturbed(room, boots, began))
        # Poses of the connected reach the teacher throughout, except while it learns of the lost ones.
        assert max(away) < LONG / 2
    eventually(lambda: len(room.listed()) == COUNT, BACK)
    proofs.add(
        f"{HERE}, the cable of one, then of {len(room.students[::3])}, out for {LONG:g} s: the longest"
        " without a pose at home, and of another's at the teacher's; until he hears them again",
        f"{max(gaps):.2f} s, {max(away):.2f} s; {back[0]:.1f} s, {back[1]:.1f} s",
        "nobody else is disturbed",
    )


def test_a_new_list_of_names_silences_nobody_for_long(room: Room, proofs: Proofs):
    boots, silences = boots_of(room), []
    for words in ("issue observer guest", "revoke guest", "issue hub uav30 --vehicle uav30"):
        began = time.monotonic()
        assert room.teacher.quadctl("keys", *words.split()).code == 0
        time.sleep(SILENT)
        room.hears(room.students, time.monotonic())
        silences.append(max(room.ear.gaps(student.name, began) for student in room.students))
        assert_undisturbed(room, boots, began)
    proofs.add(
        f"{HERE}, `keys issue` and `keys revoke` of a guest, `keys issue` of a new vehicle: the longest"
        " without a student's pose at the teacher's",
        ", ".join(f"{silence:.2f} s" for silence in silences),
        f"{SILENT:g} s",
    )
    assert max(silences) < SILENT


def test_a_revoked_student_is_out_and_the_others_are_undisturbed(room: Room, proofs: Proofs):
    boots = boots_of(room)
    gone = room.students[7]
    others = [student for student in room.students if student is not gone]
    began = time.monotonic()
    assert room.do("keys revoke uav7").code == 0
    revoked = time.monotonic()
    room.hears(others, revoked + REVOKED)
    away = max(room.ear.gaps(student.name, began) for student in others)
    last = max(room.ear.times[gone.name]) - revoked
    assert last < REVOKED
    done = room.do("hold --vehicle uav7 --timeout 0.5")
    assert done.code == 3, done
    assert "nobody served uav7/@srv/hold" in done.err
    longest = assert_undisturbed(room, boots, began)
    # The vehicle flies on at the student's own machine.
    assert gone.do("hold").code == 0
    eventually(lambda: set(room.listed()) == {student.name for student in others}, BACK)
    proofs.add(
        f"{HERE}, one revoked: until his last message; the longest without another's pose at the"
        " teacher's, and at home",
        f"{max(last, 0.0):.2f} s; {away:.1f} s, {longest:.2f} s",
        f"{REVOKED:g} s; no other is disturbed",
    )
