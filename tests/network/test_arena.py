"""Thirty students who fly vehicles on the teacher's machine, and touch neither another's nor any cage."""

from collections.abc import Iterator
from typing import Any

import pytest

from tests.network.intruder import sent
from tests.network.room import COUNT, HERE, SHARED, Ear, Room, Student, classroom, side_by_side
from tests.processes.bare import Bare
from tests.processes.running import Done, eventually
from tests.proofs import Proofs

pytestmark = [pytest.mark.prove, pytest.mark.timeout(300)]

AT = "tls/10.7.1.1:7448"
SETPOINT = ("boot=x", "for_seq=1", "position.x=9", "position.y=9", "position.z=9", "brake=false")
DENIED = (
    ("cage", "off"),
    ("cage", "off", "--vehicle", "uav8"),
    ("hold", "--vehicle", "uav8"),
    ("goto", "0", "0", "1", "--vehicle", "uav8"),
    ("topic", "pub", "input/position", *SETPOINT),
    ("topic", "pub", "input/position", *SETPOINT, "--vehicle", "uav8"),
)
"""By who has uav7."""


@pytest.fixture(scope="module")
def arena() -> Iterator[Room]:
    """All their vehicles up, and each student given his folder."""
    with classroom(COUNT) as room:
        for line in ("keys init", "keys issue hub teacher --host 10.7.1.1 --host 10.7.2.1"):
            assert room.do(line).code == 0
        # The page's `keys issue student anna --vehicle uav0`, for all at once.
        assert room.teacher.quadctl("keys", "issue", "student", "--vehicles", COUNT).code == 0
        room.teacher.start(
            *("--vehicles", COUNT, "--listen", "tls/0.0.0.0:7448"),
            *("--identity", "keys/teacher", *SHARED),
        )
        for student in room.students:
            student.be_given(room.keys)
        yield room


def ask(student: Student, *words: object) -> Done:
    """A command of a student's, to the teacher's machine."""
    return student.say(*words, "--connect", AT, "--identity", "uav7")


def touched(room: Room, bare: Bare, calls: Ear) -> dict[str, tuple[Any, ...]]:
    """What changes when anybody has asked a vehicle for anything, of all of them."""
    states = {s.name: bare.latest(f"{s.name}/safety/state") for s in room.students}
    return {
        name: (state["request"], state["cage_on"], state["boot"], len(calls.calls[name]))
        for name, state in states.items()
    }


def test_a_student_flies_his_own_and_touches_no_cage(arena: Room, proofs: Proofs):
    with arena.teacher.bare() as bare:
        calls = Ear(bare, "*/@call/**")
        before = touched(arena, bare, calls)
        flown = side_by_side(lambda s: ask(s, "goto", 1, 1, 1), arena.students)
        assert [done for done in flown if done.code] == []
        eventually(lambda: all(len(calls.calls[name]) == 1 for name in before))
        flown_to = touched(arena, bare, calls)
        assert flown_to == {
            name: (request + 1, cage_on, boot, 1)
            for name, (request, cage_on, boot, _) in before.items()
        }
        tried = side_by_side(lambda s: [ask(s, *words) for words in DENIED], arena.students)
        for student, tries in zip(arena.students, tried, strict=True):
            for done in tries:
                assert done.code == 3, (student.name, done)
                assert f"not allowed: a student of {student.name} may not" in done.err

        def intrudes(student: Student) -> list[dict[str, list[str]]]:
            identity = student.lab.folder / student.name
            enter = student.port.machine.enter
            return [sent(enter, AT, identity, student.neighbour)]

        for student, gots in zip(
            arena.students, side_by_side(intrudes, arena.students), strict=True
        ):
            own = f"{student.name}/"
            for got in gots:
                assert [key for key in got["heard"] if not key.startswith(own)] == []
                assert got["asked"] == []
        assert touched(arena, bare, calls) == flown_to
    proofs.add(
        f"{HERE}, their vehicles on the teacher's: each student at his own cage and his neighbour's,"
        " and at his neighbour's vehicle, by commands and by Zenoh alone: what was executed",
        f"0 of {COUNT * len(DENIED)} commands",
        "nothing",
    )
