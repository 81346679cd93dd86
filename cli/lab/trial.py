"""Trial of a rubric: right solutions must have full marks, and each of their mutants must lose a row.

Clegg, McMinn and Fraser (2021) judge the tests of programming exercises so.
"""

import ast
import os
import re
import shutil
import tempfile
import tokenize
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any, Literal, NamedTuple, TextIO

from msgspec import Struct, structs

from quadctl.cli.lab import grading
from quadctl.cli.lab.formats import Grade
from quadctl.cli.lab.handin import HandIn, nodes_in, unpacked
from quadctl.cli.lab.judge import RowResult
from quadctl.cli.lab.machine import Limits, Machine
from quadctl.cli.lab.mutants import OPERATORS, Mutant, mutants
from quadctl.cli.lab.rubric import rubric
from quadctl.services.runtime.errors import Invalid

_OURS = Path(__file__).parent / "solutions"
_CRASH = re.compile(r"\w+ (crashed|failed|is blocked|is not ready|does not stay up)")
"""Start of a row's output on a node that has ended or failed."""
_EVERY = 20
"""Mutants for each line on the progress."""
Outcome = Literal["lost", "crashed", "passed", "equivalent", "not judged"]
_TITLES: dict[Outcome, str] = {
    "passed": "these pass:",
    "not judged": "these could not be judged:",
    "equivalent": "equivalent, by the comments in the solutions:",
}


class Solution(Struct, frozen=True):
    """Right solution: its name, a copy of its folder, and the nodes that each of its sources is a part of."""

    name: str
    folder: Path
    nodes: dict[str, frozenset[str]]

    @property
    def every(self) -> frozenset[str]:
        """Return all its nodes."""
        return frozenset[str]().union(*self.nodes.values())


class Tried(Struct, frozen=True):
    """Mutant of a solution's file, its outcome, and the row that it lost first with its output."""

    solution: str
    file: str
    nodes: frozenset[str]
    mutant: Mutant
    outcome: Outcome = "not judged"
    row: str = ""
    output: str = ""

    @property
    def name(self) -> str:
        """Return the name, which is unique among all solutions."""
        return f"{self.solution} {self.mutant.name}"

    @property
    def why(self) -> str:
        """Return the output of the row that it lost, or the reason why it is equivalent or not judged."""
        return self.output or self.mutant.equivalent

    def document(self) -> dict[str, Any]:
        """Return the mutant as `--json` prints it."""
        return {
            "name": self.name,
            "solution": self.solution,
            "file": self.file,
            "line": self.mutant.line,
            "operator": self.mutant.operator,
            "old": self.mutant.old,
            "new": self.mutant.new,
            "outcome": self.outcome,
            "row": self.row,
            "output": self.why,
        }


class Trial(Struct, frozen=True):
    """Result of a trial: grades of the right solutions, and their mutants; `rows` are those about a mutant's node."""

    right: list[Grade]
    tried: list[Tried]
    rows: list[str]

    @property
    def ok(self) -> bool:
        """Return whether all right solutions have full marks, and every mutant that is none loses a row."""
        judged = all(each.outcome not in {"passed", "not judged"} for each in self.tried)
        return judged and all(grade.ok for grade in self.right)

    def document(self) -> dict[str, Any]:
        """Return what `--json` prints."""
        return {
            "ok": self.ok,
            "solutions": [
                {
                    "name": grade.submission,
                    "ok": grade.ok,
                    "problem": grade.problem,
                    "lost": [_row(test) for test in grade.tests if not test.ok],
                }
                for grade in self.right
            ],
            "operators": self._by_operator(),
            "mutants": [each.document() for each in self.tried],
            "idle_rows": self._idle(),
        }

    def text(self) -> str:
        """Return the result for people."""
        counts = Counter(each.outcome for each in self.tried)
        lost = f"{counts['lost'] + counts['crashed']} lose a row, {counts['crashed']} of them by a crash"
        counted = f"{lost}; {counts['passed']} pass; {counts['equivalent']} are equivalent"
        lines = [line for grade in self.right for line in _about(grade)]
        lines += ["", f"{len(self.tried)} mutants: {counted}"]
        for operator, found in self._by_operator().items():
            shown = ", ".join(f"{number} {outcome}" for outcome, number in found.items())
            lines.append(f"  {operator:20}{shown}")
        for outcome, title in _TITLES.items():
            some = [each for each in self.tried if each.outcome == outcome]
            lines += ["", title] if some else []
            lines += [f"  {': '.join(filter(None, (each.name, each.why)))}" for each in some]
        if idle := self._idle():
            lines += ["", "rows that are never the first that a mutant loses:"]
            lines += [f"  {row}" for row in idle]
        return "\n".join(lines)

    def _by_operator(self) -> dict[str, dict[str, int]]:
        found: dict[str, dict[str, int]] = {}
        for operator in OPERATORS:
            some = [each.outcome for each in self.tried if each.mutant.operator == operator]
            if some:
                found[operator] = {outcome: some.count(outcome) for outcome in sorted({*some})}
        return found

    def _idle(self) -> list[str]:
        first = {each.row for each in self.tried}
        return [row for row in self.rows if row not in first]


def _row(test: RowResult) -> dict[str, str]:
    return {"number": test.number, "name": test.name, "output": test.output}


def _about(grade: Grade) -> Iterator[str]:
    """Yield the lines on a right solution."""
    if grade.ok:
        yield f"{grade.submission}: full marks"
        return
    yield f"{grade.submission}: {grade.fault or 'right, but it loses rows; its mutants were not flown'}"
    for test in grade.tests if not grade.problem else ():
        if not test.ok:
            yield f"  {_label(test)}: {test.output.partition(chr(10))[0]}"


def _label(test: RowResult) -> str:
    return f"{test.number} {test.name}"


@contextmanager
def right_solutions(handins: Sequence[HandIn]) -> Iterator[list[Solution]]:
    """Unpack right solutions, ours if there are none, to folders that go with the block; yield them.

    Raises Invalid for one that is no hand-in, or has no source in Python.
    """
    with tempfile.TemporaryDirectory(prefix="quadctl-lab-") as made:
        found = []
        for number, handin in enumerate(handins or _ours(Path(made, "ours"))):
            own = Path(made, str(number))
            own.mkdir()
            try:
                folder = unpacked(handin, own)
                found.append(Solution(handin.name, folder, _sources(folder)))
            except Invalid as problem:
                raise Invalid(f"{handin.name}: {problem.message}", problem.hint) from problem
        yield found


def _ours(target: Path) -> list[HandIn]:
    """Write our solutions; in the package their sources are no modules."""
    for file in sorted(_OURS.rglob("*.*")):
        copy = target / file.relative_to(_OURS).with_name(file.name.removesuffix(".txt"))
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copy)
    return [HandIn(folder.name, folder) for folder in sorted(target.iterdir())]


def _sources(folder: Path) -> dict[str, frozenset[str]]:
    """Return the nodes of each source: the file that a command runs, and those that it imports."""
    found: dict[str, set[str]] = {}
    for node, command in nodes_in(folder).items():
        waiting = [word for word in command if word.endswith(".py") and (folder / word).is_file()]
        while waiting:
            file = waiting.pop()
            if node not in found.setdefault(file, set()):
                found[file].add(node)
                waiting += [name for name in _imported(folder / file) if (folder / name).is_file()]
    if not found:
        raise Invalid("its commands run no file in Python", "mutants are made of sources in Python")
    return {file: frozenset(nodes) for file, nodes in found.items()}


def _source(file: Path) -> TextIO:
    """Open a source in the encoding that it declares, or that its byte order mark shows."""
    try:
        return tokenize.open(file)
    except SyntaxError as error:
        raise Invalid(f"{file.name}: {error}", "mutants are made of a node that runs") from error


def _imported(file: Path) -> Iterator[str]:
    """Yield the files that a source may import from its folder."""
    try:
        tree = ast.parse(file.read_bytes())
    except (SyntaxError, ValueError) as error:
        raise Invalid(f"{file.name}: {error}", "mutants are made of a node that runs") from error
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (f"{alias.name.replace('.', '/')}.py" for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield f"{node.module.replace('.', '/')}.py"


def plan(right: Sequence[Solution], tables: dict[str, Any], only: str) -> list[Tried]:
    """Return the mutants to be tried; raise Invalid if the rubric has no row about a solution, or none is left.

    `only` is an operator, or a text in their names.
    """
    about = {row.about for row in rubric(tables, "the rubric").rows}
    found: list[Tried] = []
    for solution in right:
        if not solution.every & about:
            raise Invalid(
                f"{solution.name} has {' and '.join(sorted(solution.every))}, and the rubric no row"
                " about it",
                "name solutions with the nodes that the rubric is about",
            )
        for file, nodes in solution.nodes.items():
            with _source(solution.folder / file) as opened:
                text = opened.read()
            for mutant in mutants(text, file) if nodes & about else ():
                outcome: Outcome = "equivalent" if mutant.equivalent else "not judged"
                found.append(Tried(solution.name, file, nodes, mutant, outcome))
    chosen = [
        each
        for each in found
        if (each.mutant.operator == only if only in OPERATORS else only in each.name)
    ]
    if not chosen:
        raise Invalid(
            f"--only {only}: it is in the name of none of {len(found)} mutants",
            f"operators are {', '.join(OPERATORS)}",
        )
    return chosen


class Flights(NamedTuple):
    """Flights over the rows of a rubric's tables, so many at a time, on this machine."""

    tables: dict[str, Any]
    machine: Machine
    jobs: int

    def rows_about(self, nodes: frozenset[str]) -> dict[str, Any]:
        """Return the tables with the rows about these nodes alone, each with its number in the whole."""
        rows = rubric(self.tables, "the rubric").rows
        kept = [
            {"number": row.number} | table
            for row, table in zip(rows, self.tables["row"], strict=True)
            if row.about in nodes
        ]
        return {"row": kept}

    def grades(
        self,
        handins: Sequence[tuple[frozenset[str], HandIn]],
        on_done: Callable[[Grade], None],
        *,
        first_loss: bool,
    ) -> dict[str, Grade]:
        """Return the grade of each hand-in by its name, in the rows about the nodes beside it."""
        found: dict[str, Grade] = {}
        for nodes in sorted({about for about, _ in handins}, key=sorted):
            grades = grading.grade(
                [handin for about, handin in handins if about == nodes],
                self.rows_about(nodes),
                Limits(),
                jobs=self.jobs,
                machine=self.machine,
                on_done=on_done,
                first_loss=first_loss,
            )
            found |= {grade.submission: grade for grade in grades}
        return found


def fly(
    right: Sequence[Solution],
    planned: Sequence[Tried],
    flights: Flights,
    note: Callable[[str], None],
) -> Trial:
    """Fly the right solutions, then each mutant up to the first row that it loses; note the progress."""
    grades = flights.grades(
        [(each.every, HandIn(each.name, each.folder)) for each in right],
        lambda grade: note("\n".join(_about(grade))),
        first_loss=False,
    )
    folders = {each.name: each.folder for each in right if grades[each.name].ok}
    tried = [each for each in planned if each.solution in folders]
    waiting = [each for each in tried if each.outcome != "equivalent"]
    # Each thread has a number of its own.
    passed, numbers = list[str](), count(1)

    def on_done(grade: Grade) -> None:
        if grade.ok:
            passed.append(grade.submission)
            note(f"passes: {grade.submission}")
        number = next(numbers)
        if number % _EVERY == 0 or number == len(waiting):
            note(f"{number} of {len(waiting)} mutants flown, {len(passed)} pass")

    with tempfile.TemporaryDirectory(prefix="quadctl-lab-") as made:
        written = [
            (each.nodes, _written(each, folders[each.solution], Path(made, str(number))))
            for number, each in enumerate(waiting)
        ]
        judged = flights.grades(written, on_done, first_loss=True)
    rows = flights.rows_about(frozenset[str]().union(*(each.nodes for each in waiting)))["row"]
    return Trial(
        [grades[each.name] for each in right],
        [_judged(each, judged[each.name]) if each.name in judged else each for each in tried],
        [f"{row['number']} {row['name']}" for row in rows],
    )


def _written(tried: Tried, solution: Path, target: Path) -> HandIn:
    """Write a mutant as a hand-in; it shares all other files with the solution."""
    shutil.copytree(solution, target, symlinks=True, copy_function=os.link)
    file = target / tried.file
    with _source(file) as opened:
        encoding = opened.encoding
    file.unlink()
    file.write_text(tried.mutant.source, encoding)
    return HandIn(tried.name, target)


def _judged(tried: Tried, grade: Grade) -> Tried:
    """Return a mutant with the outcome of its flights."""
    if grade.problem:
        return structs.replace(tried, output=grade.problem)
    for test in grade.tests:
        if not test.ok and test.output != grading.AFTER_LOSS:
            outcome: Outcome = "crashed" if _CRASH.match(test.output) else "lost"
            return structs.replace(tried, outcome=outcome, row=_label(test), output=test.output)
    return structs.replace(tried, outcome="passed")
