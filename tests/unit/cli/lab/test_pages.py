"""Pages of grades: what a student may read, which rows fail most, and no text of a student that is more than text."""

from html.parser import HTMLParser

import pytest
from hypothesis import given, strategies as st

from quadctl.cli.lab.formats import Grade
from quadctl.cli.lab.judge import RowResult
from quadctl.cli.lab.pages import StudentLine, class_page, failing, feedback, student_page

VOID = {"meta", "img"}
EVIL = "</pre><script>alert(1)</script><img src=x onerror=alert(2)>\x1b[31m\u202e"


class Page(HTMLParser):
    """Elements, attributes and text of a page; it fails for an element that is left open."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data

    def links(self) -> list[str | None]:
        return [value for name, value in self.attributes if name == "href"]


def row(number: str, output: str = "arrived", *, ok: bool = False, visible: bool = True) -> RowResult:  # fmt: skip
    return RowResult(
        f"row {number}", number, ok, float(ok), 1.0, output, visible, "" if ok else "look"
    )


ADA = Grade("c/ada.zip", [
    row("1", ok=True), row("2", "was accepted\nsafety: x"), row("3", "seed 19: beyond", visible=False),
])  # fmt: skip
RIGHT = Grade("c/bob", [row("1", ok=True), row("2", ok=True), row("3", ok=True, visible=False)])
BAD = Grade("c/cleo", [row("1", "it is damaged")], 0.1, "it is damaged")


def test_feedback_has_evidence_and_hints_but_for_hidden_rows_evidence():
    assert feedback("ada", ADA) == (
        "ada: 1 of 3 points\n\n"
        "2  row 2: 0 of 1\n    was accepted\n    safety: x\n    hint: look\n\n"
        "3  row 3: 0 of 1\n    not shown: a hidden row\n    hint: look\n"
    )


def test_feedback_is_short_when_all_is_well_or_nothing_could_be_graded():
    assert feedback("bob", RIGHT) == "bob: 3 of 3 points\n\nEvery row holds.\n"
    assert feedback("cleo", BAD) == "cleo: 0 of 1 points\n\nnot gradable: it is damaged\n"


def test_feedback_has_nothing_that_controls_a_terminal():
    text = feedback(EVIL, Grade("x", [row("1", EVIL)]))
    assert text.isprintable() or set(filter(lambda c: not c.isprintable(), text)) == {"\n"}


def test_a_report_has_each_row_with_evidence_hint_picture_and_files():
    page = student_page("ada", ADA, ["1 more point"], b"png", ["safety.log", "flight.mcap"])
    found = Page(page)
    for text in ("ada: 1 of 3 points", "was accepted\nsafety: x", "Hint: look", "1 more point"):
        assert text in found.text
    assert "seed 19: beyond" in found.text
    assert found.links() == ["safety.log", "flight.mcap"]
    assert ("src", "data:image/png;base64,cG5n") in found.attributes
    assert "Flights" not in student_page("ada", ADA, [], None, [])


@pytest.mark.parametrize(
    "grade", [Grade("x", [row("1", EVIL)], 0.0, EVIL), Grade(EVIL, [row("1", EVIL)])]
)
def test_what_a_student_writes_is_text_on_both_pages(grade: Grade):
    plain = Grade("x", [row("1", "y")], 0.0, grade.problem and "y")

    def pages(name: str, each: Grade) -> list[Page]:
        report = student_page(name, each, [name], None, [name])
        return [Page(report), Page(class_page([StudentLine(name, name, each)], 3))]

    for found, expected in zip(pages(EVIL, grade), pages("x", plain), strict=True):
        assert found.tags == expected.tags
        assert [name for name, _ in found.attributes] == [name for name, _ in expected.attributes]
        assert "<script>" in found.text
        assert "\x1b" not in found.text
        assert "\u202e" not in found.text
        assert not any(str(link).startswith(("javascript:", "http")) for link in found.links())


@given(st.text(), st.text(), st.text())
def test_no_text_opens_or_closes_an_element(name: str, output: str, problem: str):
    def pages(name: str, output: str, problem: str) -> list[Page]:
        tests = [row("1", f"#{output}"), row("2", f"#{output}", ok=True)]
        grade = Grade(name, tests, 1.0, problem)
        report = student_page(name, grade, [output], None, [name])
        return [Page(report), Page(class_page([StudentLine(name, name, grade)], 1))]

    for found, plain in zip(
        pages(name, output, problem), pages("x", "x", problem and "x"), strict=True
    ):
        assert found.tags == plain.tags


def test_a_class_page_has_students_and_the_rows_that_fail_most():
    dora = Grade("c/dora", [row("1", "late by 3.1 s"), row("2", "late"), row("3", "x", visible=False)])  # fmt: skip
    entries = [
        StudentLine("ada", "ada", ADA), StudentLine("bob", "b ö", RIGHT), StudentLine("cleo", "cleo", BAD),
        StudentLine("dora", "dora", dora), StudentLine("ed", "ed", None),
    ]  # fmt: skip
    found = Page(class_page(entries, 4711))
    assert found.links() == [
        "ada/report.html", "b%20%C3%B6/report.html", "cleo/report.html", "dora/report.html",
    ]  # fmt: skip
    for text in (
        "5 hand-ins", "mean 1.33 of 3 points", "1 not gradable", "1 not graded yet", "seed: 4711",
        "not gradable: it is damaged",
    ):  # fmt: skip
        assert text in found.text
    below = found.text.partition("most failed first")[2]
    assert [below.index(name) for name in ("row 2", "row 3", "row 1")] == sorted(
        below.index(name) for name in ("row 1", "row 2", "row 3")
    )


def test_evidence_that_differs_in_numbers_alone_is_counted_together():
    outputs = ["was accepted", "1.02 m away", "was accepted at 3 s", "0.7 m away\nmore"]
    (found,) = failing(Grade(str(n), [row("1", each)]) for n, each in enumerate(outputs))
    assert (found.fails, found.evidence, found.times) == (4, "1.02 m away", 2)


def test_the_page_of_a_class_with_nobody_graded_is_a_page():
    assert "1 hand-in" in Page(class_page([StudentLine("ada", "ada", None)], 1)).text
    assert "cleo" in Page(class_page([StudentLine("cleo", "cleo", BAD)], 1)).text
