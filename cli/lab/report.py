"""Reports of grades on disk: a student's folder, and the folder of a class, which can be graded anew."""

import re
import shutil
import unicodedata
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from quadctl.cli.lab import pages
from quadctl.cli.lab.formats import Grade, students
from quadctl.cli.lab.handin import NODES, HandIn
from quadctl.cli.lab.judge import NOT_FLOWN, RECORDING, log_of
from quadctl.schemas.typed import from_json
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.files import making, write_whole
from quadctl.services.runtime.params.names import nearest

_PAGE, _RESULTS, _FEEDBACK, _PICTURE = "report.html", "results.json", "feedback.txt", "flight.png"
_CLASS, _CLASS_PAGE = "class.json", "index.html"
_EVIDENCE = (*map(log_of, NODES), RECORDING)
_LONGEST = 60
"""Characters of a student's folder: a letter has up to four bytes, and a file's name 255."""
_DEVICES = {"con", "prn", "aux", "nul", *(f"{at}{n}" for at in ("com", "lpt") for n in range(10))}
"""Names that Windows keeps for devices, with any ending."""
_ANOTHER = "name another folder: --report"
_T = TypeVar("_T")


def clear(folder: Path) -> None:
    """Remove the logs, the recording and the picture of a grading; raises OSError."""
    for name in (*_EVIDENCE, _PICTURE):
        (folder / name).unlink(missing_ok=True)


def keep(evidence: Path, folder: Path, note: Callable[[str], None]) -> None:
    """Move the logs and the recording of a grading to a student's folder; note if they cannot be written.

    They and the picture replace those of the grading before.
    """
    try:
        clear(folder)
        for name in _EVIDENCE:
            if (evidence / name).exists():
                shutil.move(evidence / name, folder / name)
    except OSError as error:
        note(f"no logs or recording: {folder} cannot be written: {error.strerror}")


def write_page(
    folder: Path, name: str, grade: Grade, lines: Sequence[str], note: Callable[[str], None]
) -> Path:
    """Write a student's report with some more lines, and with a picture if there is a recording; return its file.

    Raises Invalid if it cannot be written; a picture that cannot be drawn is noted.
    """
    picture = _picture(folder, note)
    files = [file for file in (*_EVIDENCE, _PICTURE) if (folder / file).exists()]
    page = pages.student_page(name, grade, lines, picture, files)
    write_whole(folder / _PAGE, page.encode())
    return folder / _PAGE


def _picture(folder: Path, note: Callable[[str], None]) -> bytes | None:
    target = folder / _PICTURE
    if not (folder / RECORDING).exists():
        return None
    try:
        if not target.exists():
            from quadctl.cli.plot.figure import draw
            from quadctl.cli.plot.plot import recorded

            draw(target, recorded(folder / RECORDING), "the flights of the rubric")
        return target.read_bytes()
    except Exception as error:  # noqa: BLE001 - a picture is worth no mark; the package that draws may be missing
        note(f"no picture: {error}")
        return None


class Student(Struct, frozen=True):
    """Student of a class: the name on its pages, the hand-in as the results name it, and the folder."""

    name: str
    submission: str
    folder: str


class ClassRecord(Struct, frozen=True):
    """Content of class.json: the seed and the rubric of a class, and its students."""

    seed: int
    rubric: dict[str, Any]
    students: list[Student] = []


def record_in(folder: Path) -> ClassRecord | None:
    """Return the record of the class in a folder, None without one; raise Invalid if it is unreadable."""
    return _read(folder / _CLASS, ClassRecord)


def _read(file: Path, kind: type[_T]) -> _T | None:
    try:
        return from_json(file.read_bytes(), kind)
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise Invalid(f"{file} cannot be read: {error}", _ANOTHER) from error


class ClassReport:
    """Folder of a class: a folder for each student, the class page, and the record to grade it anew."""

    def __init__(self, folder: Path, record: ClassRecord, note: Callable[[str], None]) -> None:
        """Read the results that are there; raise Invalid if they are unreadable."""
        self._folder, self._note, self._noted = folder, note, set[str]()
        self._record = record
        self._students = {student.submission: student for student in record.students}
        self._grades: dict[str, Grade] = {}
        for student in record.students:
            if grade := _read(folder / student.folder / _RESULTS, Grade):
                self._grades[student.submission] = grade

    def enter(self, handins: Sequence[HandIn], *, anew: bool) -> None:
        """Make a folder for each hand-in, and write the record.

        Raises Invalid for a hand-in that is given twice, for one without results whose rows are graded `anew`,
        and if the folder cannot be written.
        """
        names = [handin.name for handin in handins]
        for name in names:
            if names.count(name) > 1:
                raise Invalid(f"{name} is given twice", "give each hand-in once")
            if anew and name not in self._grades:
                hint = nearest(name, self._grades) or "leave out --row to grade all its rows"
                raise Invalid(f"{self._folder} has no results of {name}", hint)
        for student, name in zip(students(names), names, strict=True):
            if name not in self._students:
                taken = [each.folder for each in self._students.values()]
                self._students[name] = Student(student, name, folder_name(student, taken))
            own = self._own(name)
            with making(own):
                own.mkdir(parents=True, exist_ok=True)
        self._record = replace(self._record, students=list(self._students.values()))
        record = msgspec.json.format(msgspec.json.encode(self._record), indent=2)
        write_whole(self._folder / _CLASS, record)

    def keep(self, handin: HandIn, evidence: Path) -> None:
        """Move the logs and the recording of a hand-in to its student's folder."""
        keep(evidence, self._own(handin.name), self._say)

    def add(self, grade: Grade) -> None:
        """Take a grade, of all rows or of some anew, and write its student's pages and the class page.

        What cannot be written is noted: it is worth nobody's mark.
        """
        name = grade.submission
        self._grades[name] = merged(self._grades.get(name), grade)
        try:
            self._write(self._students[name], self._grades[name])
        except Invalid as problem:
            self._say(problem.message)

    def grades(self, handins: Sequence[HandIn]) -> list[Grade]:
        """Return the grades of hand-ins, with all their rows."""
        return [self._grades[handin.name] for handin in handins]

    @property
    def page(self) -> Path:
        """Return the file of the class page."""
        return self._folder / _CLASS_PAGE

    def _write(self, student: Student, grade: Grade) -> None:
        own = self._own(student.submission)
        document = msgspec.json.format(msgspec.json.encode(grade.document()), indent=2)
        write_whole(own / _RESULTS, document)
        write_whole(own / _FEEDBACK, pages.feedback(student.name, grade).encode())
        write_page(own, student.name, grade, [], self._say)
        entries = [
            pages.StudentLine(each.name, each.folder, self._grades.get(each.submission))
            for each in self._students.values()
        ]
        write_whole(self.page, pages.class_page(entries, self._record.seed).encode())

    def _own(self, submission: str) -> Path:
        return self._folder / self._students[submission].folder

    def _say(self, text: str) -> None:
        """Note a text, the same one once: a class has many hand-ins."""
        if text not in self._noted:
            self._noted.add(text)
            self._note(text)


def merged(former: Grade | None, new: Grade) -> Grade:
    """Return a new grade; if a former one has more rows, that one with the new results in it.

    Some rows that cannot be graded anew leave the former ones as they are.
    """
    if former is None:
        return new
    anew = {test.name: test for test in new.tests}
    left = [test for test in former.tests if test.name not in anew]
    if not left:
        return new
    if new.problem:
        return former
    unflown = {former.problem, NOT_FLOWN}
    problem = former.problem if any(test.output in unflown for test in left) else ""
    tests = [anew.get(test.name, test) for test in former.tests]
    return replace(former, tests=tests, problem=problem)


def folder_name(student: str, taken: Collection[str]) -> str:
    """Return a name of a student's folder, new among those taken, on any system and in any shell."""
    name = unicodedata.normalize("NFC", student)
    name = "".join(each if each.isalnum() or each in " ._-" else "_" for each in name)
    name = re.sub(r"^[ .-]+|[ .]+$", "", name[:_LONGEST]) or "student"
    if name.partition(".")[0].strip().casefold() in _DEVICES:
        name = f"_{name}"
    others = {each.casefold() for each in (*taken, _CLASS, _CLASS_PAGE)}
    suffixes = ("", *(f"-{number}" for number in range(2, len(others) + 2)))
    return next(new for end in suffixes if (new := f"{name}{end}").casefold() not in others)
