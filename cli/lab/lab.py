"""`lab new`, `lab check`, `lab grade` and `lab rubric check`."""

import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from quadctl.cli import output
from quadctl.cli.context import Options, require_local
from quadctl.cli.declarations import Arg, Option
from quadctl.services.runtime.errors import Invalid, QuadctlError, UsageError
from quadctl.services.runtime.files import making, refuse_existing, write_new, write_whole
from quadctl.services.runtime.params.load import read
from quadctl.services.runtime.params.names import nearest

if TYPE_CHECKING:
    from quadctl.cli.lab.handin import HandIn
    from quadctl.cli.lab.machine import Machine
    from quadctl.cli.lab.report import ClassRecord

_HERE = Path(__file__).parent
_VISIBLE, _HIDDEN = _HERE / "rubric.toml", _HERE / "hidden.toml"
_EXTRA = _HERE / "extra.toml"
_TEMPLATE = _HERE / "template"
_SEEDS = range(100_000, 1_000_000)
"""Seeds to draw from: nobody guesses one."""
_SAME = "leave the option out, or name another folder: --report"
_NEEDS = "`quadctl lab new DIR` writes one"
_HAND_INS = "give folders or zip files, e.g. `quadctl lab grade handins/*`"


def new(
    options: Options,
    folder: Annotated[Path, Arg("A new or empty folder.", "DIR")],
) -> None:
    """Write a student's folder: two nodes to complete, the visible rubric, tests, and LAB.md.

    Example: quadctl lab new mylab
    """
    # Sources of a student are no modules of ours.
    files = sorted(_TEMPLATE.iterdir())
    texts = {path.name.removesuffix(".txt"): path.read_text("utf-8") for path in files}
    texts |= {rows.name: rows.read_text("utf-8") for rows in (_VISIBLE, _EXTRA)}
    there = [name for name in texts if (folder / name).exists()]
    if there:
        raise Invalid(f"{folder / there[0]} already exists", "choose another folder")
    with ExitStack() as undo:
        with making(folder):
            if not folder.is_dir():
                folder.mkdir(parents=True)
                undo.callback(folder.rmdir)
        for name, text in texts.items():
            write_new(folder / name, text)
            undo.callback((folder / name).unlink)
        undo.pop_all()
    document = {"folder": str(folder), "files": sorted(texts)}
    output.either(
        options, document, f"wrote {', '.join(sorted(texts))} to {folder}; begin with LAB.md"
    )


def check(
    options: Options,
    folder: Annotated[Path, Arg("A folder of `lab new` (default: this one).", "DIR")] = Path(),
    report_folder: Annotated[
        Path | None, Option("Folder of the report (default: DIR/report).", ("--report",), "DIR")
    ] = None,
) -> None:
    """Fly the visible rubric against your nodes, and write a report with the flight's picture.

    Your nodes run in the sandbox of `lab grade`. Exits with 8 if a row does not hold.

    Example: quadctl lab check mylab
    """
    require_local(options, "lab check")
    from quadctl.cli.lab import formats, grading, machine, report
    from quadctl.cli.lab.handin import HandIn, encodable, nodes_in
    from quadctl.cli.lab.judge import RowResult
    from quadctl.cli.lab.rubric import drawn, rubric, visible

    own = folder / "rubric.toml"
    file = own if own.exists() else _VISIBLE
    tables = _with_hidden(read(file, _NEEDS))
    points = rubric(tables, str(file)).points
    rows = drawn(visible(tables), 0)
    if not folder.is_dir():
        if folder.exists():
            hint = "unpack it, and name its folder; `quadctl lab grade` takes archives"
            raise Invalid(f"{folder} is no folder", hint)
        raise Invalid(f"there is no folder {folder}", _NEEDS)
    nodes_in(folder)
    target = report_folder or folder / "report"
    with making(target):
        target.mkdir(parents=True, exist_ok=True)
        report.clear(target)
    means = machine.probe()
    if means.gaps():
        output.note(f"`lab grade` shuts hand-ins in more closely than this machine: {means.lacks}")
    _compile_vehicle()

    def on_row(result: RowResult) -> None:
        if not options.json:
            output.line(f"{'ok  ' if result.ok else 'FAIL'}  {result.number}  {result.name}")

    name = encodable(folder.absolute().name)
    with _noting(lambda: "stopped: the other rows are not flown, and there is no report"):
        (graded,) = grading.grade(
            [HandIn(name, folder)],
            rows,
            machine.Limits(),
            jobs=1,
            machine=means,
            on_done=lambda _grade: None,
            on_row=on_row,
            keep=lambda _handin, evidence: report.keep(evidence, target, output.note),
        )
    unseen = _unseen(points - graded.max_score)
    page = report.write_page(target, name, graded, unseen, output.note)
    if options.json:
        output.document(graded.document())
    else:
        for line in (*formats.text(graded).splitlines(), *unseen):
            output.line(line)
        output.line(f"report: {page}")
    output.end(ok=graded.ok)


def grade(
    options: Options,
    submissions: Annotated[
        list[str] | None, Arg("Folders, zip or tar files; or a class's export.", "SUBMISSION...")
    ] = None,
    rubric: Annotated[
        Path | None, Option("Rubric, TOML (default: the built-in one).", metavar="FILE")
    ] = None,
    format: Annotated[  # noqa: A002 - the option's name
        str, Option("text, json, csv, gradescope, junit or github.")
    ] = "text",
    output_file: Annotated[
        Path | None, Option("Write to a file.", ("-o", "--output"), "FILE")
    ] = None,
    force: Annotated[bool, Option("Overwrite a file of --output that is there.")] = False,
    jobs: Annotated[
        int | None, Option("Hand-ins at a time (default: one for each processor).", min=1)
    ] = None,
    seconds: Annotated[float, Option("Limit for one node, s of a processor.")] = 60.0,
    wall: Annotated[
        float, Option("Last limit for one hand-in, s; beyond it, it is not graded.")
    ] = 1800.0,
    memory: Annotated[int, Option("Limit for one node, MB.", min=64)] = 1024,
    report: Annotated[
        Path | None,
        Option("Folder for a report on each student, and for the class page.", metavar="DIR"),
    ] = None,
    row: Annotated[
        list[str] | None,
        Option("Grade only the row with this number; repeat it for more.", metavar="NUMBER"),
    ] = None,
    student: Annotated[
        list[str] | None,
        Option("Grade only this student of an export; repeat it for more.", metavar="NAME"),
    ] = None,
    seed: Annotated[
        int | None,
        Option(
            "Seed of the goals and the hidden flights, one for a class (default: drawn).", min=0
        ),
    ] = None,
    trust: Annotated[
        bool, Option("Grade also where this machine cannot shut hand-ins in completely.")
    ] = False,
) -> None:
    """Grade hand-ins: fly the rubric against the nodes of each, in a sandbox.

    A machine without namespaces cannot shut them in completely: there it asks for --trust.
    With --report, hand-ins join the class that the folder has, with its seed and rubric.
    Exits with 0 when all have been graded, whatever their points.

    Example: quadctl lab grade handins/*.zip --format csv -o points.csv
    """
    require_local(options, "lab grade")
    from quadctl.cli.lab import formats, grading, machine
    from quadctl.cli.lab.report import ClassReport
    from quadctl.cli.lab.rubric import drawn, selected

    handins = _handins(submissions or [], format)
    if output_file:
        refuse_existing(output_file, force=force)
    if student:
        handins = _of(student, handins)
    record = _record(report, rubric, seed)
    chosen = selected(record.rubric, row) if row else record.rubric
    rows = drawn(chosen, record.seed)
    made = ClassReport(report, record, output.note) if report else None
    means = _means(trust=trust)
    if made:
        made.enter(handins, anew=bool(row))
    if rows != chosen:
        output.note(f"drawn from --seed {record.seed}")
    done = 0

    def on_done(graded: formats.Grade) -> None:
        nonlocal done
        done += 1
        points = f"{graded.score:g} of {graded.max_score:g}"
        output.note(f"{done}/{len(handins)}  {graded.submission}: {graded.fault or points}")
        if made:
            made.add(graded)

    kept = "the same command grades all anew" if made else "nothing is written"
    with _noting(lambda: f"stopped: {done} of {len(handins)} are graded; {kept}"):
        _compile_vehicle()
        grades = grading.grade(
            handins,
            rows,
            machine.Limits(seconds=seconds, wall=wall, memory=memory),
            jobs=jobs or os.cpu_count() or 1,
            machine=means,
            on_done=on_done,
            keep=made.keep if made else None,
        )
    if faults := sum(bool(graded.problem) for graded in grades):
        output.note(f"{faults} of {len(grades)} not gradable, see above")
    if made:
        grades = made.grades(handins)
        output.note(f"class page: {made.page}")
    text = formats.written("json" if options.json and format == "text" else format, grades)
    if output_file is None:
        output.write(text)
        return
    write_whole(output_file, text.encode())


@contextmanager
def _noting(text: Callable[[], str]) -> Iterator[None]:
    """Print a note if Ctrl-C ends the block."""
    try:
        yield
    except KeyboardInterrupt:
        output.note(text())
        raise


def _handins(submissions: list[str], form: str) -> "list[HandIn]":
    """Return the hand-ins that are named; raise UsageError or Invalid if there are none, or too many for the form."""
    from quadctl.cli.lab import exports, formats
    from quadctl.cli.lab.handin import HandIn, encodable

    if form not in formats.FORMS:
        hint = nearest(form, formats.FORMS) or f"one of {', '.join(formats.FORMS)}"
        raise UsageError(f"--format {form}: there is no such form", hint)
    if not submissions:
        raise UsageError("there is no hand-in to grade", _HAND_INS)
    paths = [Path(each) for each in submissions]
    for path in paths:
        if not path.exists():
            raise Invalid(f"there is no hand-in {path}", _HAND_INS)
    formats.require_fit(form, len(paths))
    # Among others, a student's archive must not name other students.
    if len(paths) == 1 and not formats.is_of_one(form):
        return exports.handins_in(paths[0])
    return [HandIn(encodable(str(path)), path) for path in paths]


def _of(names: list[str], handins: "list[HandIn]") -> "list[HandIn]":
    """Return the hand-ins of the students with these names; raise Invalid for a name that none has."""
    from quadctl.cli.lab.formats import students

    found = dict(zip(students([each.name for each in handins]), handins, strict=True))
    for name in names:
        if name not in found:
            hint = nearest(name, found) or f"one of {', '.join(list(found)[:5])}"
            raise Invalid(f"--student {name}: no hand-in is of that name", hint)
    return [found[name] for name in dict.fromkeys(names)]


def _record(report: Path | None, rubric: Path | None, seed: int | None) -> "ClassRecord":
    """Return the record of the class in a report, else a new one; raise Invalid if it has another seed or rubric."""
    from quadctl.cli.lab.report import ClassRecord, record_in

    tables = _tables(rubric) if rubric else _with_hidden(read(_VISIBLE, _NEEDS))
    record = record_in(report) if report else None
    if record is None:
        return ClassRecord(secrets.choice(_SEEDS) if seed is None else seed, tables)
    if seed not in {None, record.seed}:
        raise Invalid(f"--seed {seed}: the class in {report} has {record.seed}", _SAME)
    if rubric and tables != record.rubric:
        raise Invalid(f"--rubric {rubric}: the class in {report} has another rubric", _SAME)
    return record


def _means(*, trust: bool) -> "Machine":
    """Return the means to shut hand-ins in; raise QuadctlError without trust if they do so incompletely."""
    from quadctl.cli.lab import machine

    means = machine.probe()
    if gaps := means.gaps():
        cannot = (
            f"this machine cannot shut hand-ins in completely ({means.lacks}): one could {gaps}"
        )
        if not trust:
            raise QuadctlError(
                cannot, "grade on one that can, or add --trust if you trust the hand-ins"
            )
        output.note(cannot)
    return means


def check_rubric(
    options: Options,
    rubric: Annotated[
        Path | None, Arg("Rubric, TOML (default: the built-in one).", "RUBRIC")
    ] = None,
    solutions: Annotated[
        list[str] | None, Arg("Right solutions, as hand-ins (default: ours).", "SOLUTION...")
    ] = None,
    only: Annotated[
        str,
        Option("Only mutants by this operator, or with this text in their names.", metavar="TEXT"),
    ] = "",
    jobs: Annotated[
        int | None, Option("Flights at a time (default: one for each processor).", min=1)
    ] = None,
    trust: Annotated[
        bool, Option("Fly also where this machine cannot shut hand-ins in completely.")
    ] = False,
) -> None:
    """Check a rubric: right solutions have full marks, and each mutant of them loses a row.

    A mutant is a right solution with one fault. Exits with 8 if a mutant passes, or a right solution
    loses a row.

    Example: quadctl lab rubric check rubric.toml
    """
    require_local(options, "lab rubric check")
    from quadctl.cli.lab import trial
    from quadctl.cli.lab.handin import HandIn

    tables = _tables(rubric) if rubric else _with_hidden(read(_VISIBLE, _NEEDS))
    for path in map(Path, solutions or ()):
        if not path.exists():
            raise Invalid(
                f"there is no solution {path}", "give folders or archives, as for grading"
            )
    handins = [HandIn(path, Path(path)) for path in solutions or ()]
    with trial.right_solutions(handins) as right:
        planned = trial.plan(right, tables, only)
        means = _means(trust=trust)
        _compile_vehicle()
        flights = trial.Flights(tables, means, jobs or os.cpu_count() or 1)
        done = trial.fly(right, planned, flights, output.note)
    output.either(options, done.document(), done.text())
    output.end(ok=done.ok)


def _compile_vehicle() -> None:
    """Compile the vehicle first: a run of seconds ends before, and each would begin anew."""
    from quadctl.services.dynamics import compiler

    if compiler.is_due():
        output.note("compiling the vehicle, once for this machine")
        compiler.have_made()


def _with_hidden(tables: dict[str, Any]) -> dict[str, Any]:
    """Return a rubric's tables; for the built-in rubric with the rows that students do not see."""
    # A teacher grades a rubric of his own with rows of his own, which are not known here.
    if tables != read(_VISIBLE, _NEEDS) or not _HIDDEN.exists():
        return tables
    return {"row": [*tables["row"], *read(_HIDDEN, _NEEDS)["row"]]}


def _unseen(points: float) -> list[str]:
    """Return a line on the points that a check leaves out; none if it leaves none out."""
    if not points:
        return []
    many = "more point is" if points == 1 else "more points are"
    return [f"{points:g} {many} in rows that only `lab grade` flies"]


def _tables(file: Path) -> dict[str, Any]:
    """Return a rubric's tables; raise Invalid for a missing file or a bad rubric."""
    from quadctl.cli.lab.rubric import rubric

    tables = read(file, _NEEDS)
    rubric(tables, str(file))
    return tables
