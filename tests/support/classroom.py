"""Classroom of docs/how-to/many-machines.md: the machines of teacher and students on one network."""

import shutil
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import zenoh

from tests.support.bare import Bare, pack, speed, unpack
from tests.support.lab import Lab, private_lab
from tests.support.namespaces import Machine, Port, one_network
from tests.support.running import Done, eventually

S = TypeVar("S")
T = TypeVar("T")

PAGE = (Path(__file__).parents[2] / "docs" / "how-to" / "many-machines.md").read_text(
    encoding="utf-8"
)
COUNT = 30
HERE = f"{COUNT} students' machines and a teacher's on one network"
AT = "tls/10.7.1.1:7447"
HZ = 20
"""Rate of the poses: here thirty vehicles share the processors of one machine."""
SHARED = ("--set", f"dynamics.rate={HZ}", "--set", "safety.pose_timeout=5",
          "--set", "dynamics.setpoint_timeout=5", "--set", "supervise.answer_timeout=30")  # fmt: skip
"""Longer timeouts: a process that waits for a shared core must not count as dead."""
NICE = ("nice", "-n", "5")
"""Lower priority for students' vehicles: a real teacher's machine has its own processors."""
BACK = 20.0
"""Seconds until the teacher receives poses of a student readmitted or plugged in again."""
FLIGHT = 30.0
"""Seconds in which any flight ends."""
AT_REST = 0.05
"""Speed (m/s) below which a vehicle is at rest."""
_AT_ONCE = 4
"""Number of concurrent commands: they wait for processors rather than for vehicles."""


def as_written(line: str) -> list[str]:
    """Return the words of a command that the page contains."""
    assert f"$ quadctl {line}\n" in PAGE, line
    return line.split()


def side_by_side(do: Callable[[S], T], over: Iterable[S], at_once: int = _AT_ONCE) -> list[T]:
    """Call `do` for all items, `at_once` at a time."""
    with ThreadPoolExecutor(at_once) as pool:
        return list(pool.map(do, over))


class Ear:
    """Messages that reach a hub, by vehicle."""

    def __init__(self, bare: Bare, *keys: str) -> None:
        self.count: dict[str, int] = defaultdict(int)
        self.times: dict[str, list[float]] = defaultdict(list)
        """Arrival time of each pose, monotonic s."""
        self.pose: dict[str, dict[str, Any]] = {}
        self.boots: dict[str, set[str]] = defaultdict(set)
        self.state: dict[str, dict[str, Any]] = {}
        self.calls: dict[str, list[Any]] = defaultdict(list)
        self.ears = [bare.session.declare_subscriber(key, self._on_sample) for key in keys]

    def close(self) -> None:
        """Undeclare the subscribers."""
        for ear in self.ears:
            ear.undeclare()

    def gaps(self, vehicle: str, since: float) -> float:
        """Return the longest time (s) without a pose of the vehicle since a moment."""
        times = [since, *(at for at in self.times[vehicle] if at > since), time.monotonic()]
        return max(b - a for a, b in pairwise(times))

    def rate(self, vehicle: str, since: float) -> float:
        """Return the rate of the vehicle's poses since a moment, Hz."""
        return sum(at > since for at in self.times[vehicle]) / (time.monotonic() - since)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        vehicle, _, name = str(sample.key_expr).partition("/")
        self.count[vehicle] += 1
        if name == "pose":
            self.times[vehicle].append(time.monotonic())
            self.pose[vehicle] = unpack(sample.payload.to_bytes())
            self.boots[vehicle].add(self.pose[vehicle]["boot"])
        elif name == "safety/state":
            self.state[vehicle] = unpack(sample.payload.to_bytes())
        elif name.startswith("@call/"):
            self.calls[vehicle].append(unpack(sample.payload.to_bytes())["request"])


class Student:
    """Student with a laptop that flies one vehicle, next to a neighbour's."""

    def __init__(self, name: str, neighbour: str, port: Port, lab: Lab) -> None:
        self.name, self.neighbour, self.port, self.lab = name, neighbour, port, lab

    def do(self, line: str, *more: object) -> Done:
        """Run a command of the page's student, with uav7 as his own and uav8 as his neighbour's."""
        return self.say(*as_written(line), *more)

    def say(self, *words: object) -> Done:
        """Run any other command, with the same names replaced."""
        named = {"uav7": self.name, "uav8": self.neighbour}
        return self.lab.quadctl(*(named.get(str(word), word) for word in words))

    def copy_keys(self, keys: Path) -> None:
        """Copy the student's folder from the teacher's, as with a memory stick."""
        shutil.copytree(keys / self.name, self.lab.folder / self.name)

    def start(self, keys: Path) -> None:
        """Copy the folder, and start the student's run."""
        self.copy_keys(keys)
        up = self.do(f"up -d --vehicle uav7 --connect {AT} --identity uav7", *SHARED)
        assert up.code == 0, up.err

    def listen(self, bare: Bare) -> None:
        """Subscribe to his vehicle's messages and to all calls."""
        topics = (f"{self.name}/{topic}" for topic in ("pose", "safety/state"))
        self.bare, self.ear = bare, Ear(bare, *topics, "*/@call/**")

    def state(self) -> dict[str, Any]:
        """Return his vehicle's safety state."""
        state: dict[str, Any] = self.bare.latest(f"{self.name}/safety/state")
        return state

    def goto(self, goal: dict[str, float]) -> None:
        """Send his vehicle to a point as his own command does, and wait until it flies there."""
        answer = self.bare.query(f"{self.name}/@srv/goto", pack(goal))
        assert answer.value == {"accepted": True, "reason": ""}, answer
        eventually(lambda: self.ear.state[self.name]["goal"] == goal)

    def rests(self) -> bool:
        """Return whether his vehicle hovers at rest."""
        ear, name = self.ear, self.name
        return ear.state[name]["state"] == "HOVERING" and speed(ear.pose[name]) < AT_REST

    def at(self) -> dict[str, float]:
        """Return his vehicle's position, m."""
        place: dict[str, float] = self.ear.pose[self.name]["position"]
        return place

    def touched(self) -> tuple[Any, ...]:
        """Return the values that change with any call to his vehicle."""
        state = self.state()
        return state["request"], state["cage_on"], state["boot"], len(self.ear.calls[self.name])

    def restarts(self) -> int:
        """Return the number of restarts of his processes."""
        return sum(node["restarts"] for node in self.lab.nodes().values())


class Room:
    """Teacher's lab and the students."""

    def __init__(self, machine: Machine, teacher: Lab, students: list[Student]) -> None:
        self.machine, self.teacher, self.students = machine, teacher, students

    def do(self, line: str, *more: object) -> Done:
        """Run a command of the page's teacher."""
        return self.teacher.quadctl(*as_written(line), *more)

    def open(self) -> None:
        """Create the keys, and start the common hub."""
        lines = (
            "keys init",
            "keys issue hub teacher --host 10.7.1.1 --host 10.7.2.1",
            "keys issue hub --vehicles 30",
            "hub -d --listen tls/0.0.0.0:7447 --identity keys/teacher",
        )
        for line in lines:
            done = self.do(line)
            assert done.code == 0, done.err

    @property
    def keys(self) -> Path:
        """Return the folder of the fleet's keys."""
        return self.teacher.folder / "keys"

    def start(self) -> None:
        """Start all students' runs."""
        side_by_side(lambda student: student.start(self.keys), self.students)

    def listed(self) -> dict[str, dict[str, Any]]:
        """Return the rows of the teacher's `fleet list` by vehicle, empty if it fails."""
        done = self.teacher.quadctl("fleet", "list", "--json")
        return {row["vehicle"]: row for row in done.json} if done.code == 0 else {}

    def listen(self, held: ExitStack) -> None:
        """Subscribe the teacher and all students to their messages."""
        bare = held.enter_context(self.teacher.bare())
        self.ear = Ear(bare, "*/pose")
        for student in self.students:
            student.listen(held.enter_context(student.lab.bare()))
        eventually(lambda: len(self.ear.pose) == len(self.students))
        eventually(lambda: all(s.ear.pose and s.ear.state for s in self.students))

    def hears(self, students: Iterable[Student], after: float) -> None:
        """Wait until the teacher has received their poses after a moment (monotonic s)."""
        students = list(students)
        eventually(lambda: all(self.ear.times[s.name][-1] > after for s in students), BACK)

    def rests(self) -> None:
        """Wait until all vehicles hover at rest."""
        eventually(lambda: all(student.rests() for student in self.students), FLIGHT)


@contextmanager
def classroom(count: int) -> Iterator[Room]:
    """Set up the machines of the students and the teacher, with no run yet."""
    with ExitStack() as held:
        machine, ports = held.enter_context(one_network(count))
        teacher = held.enter_context(private_lab(machine.enter))
        students = []
        for number, port in enumerate(ports):
            lab = held.enter_context(private_lab([*port.machine.enter, *NICE]))
            students.append(Student(f"uav{number}", f"uav{(number + 1) % count}", port, lab))
        # Concurrently, which is faster than one after the other when the labs end.
        held.callback(side_by_side, lambda lab: lab.quadctl("down"), [s.lab for s in students])
        yield Room(machine, teacher, students)
