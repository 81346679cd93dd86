"""Output of commands: tables, fields, documents, errors."""

import io
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings, strategies as st

from quadctl.cli import output
from quadctl.cli.progress import Progress
from quadctl.schemas.messages import CageSize
from quadctl.services.runtime.errors import Invalid, NotReady, QuadctlError

FULL = Path("/dev/full")


@pytest.mark.parametrize("line", ["type list", "type list --json"])
def test_a_full_disk_under_stdout_is_an_error_without_a_traceback(line: str):
    with FULL.open("w") as full:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "quadctl.cli.main", *line.split()],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            timeout=30,
        )
    assert done.returncode == 1
    assert "the output cannot be written: No space left on device" in done.stderr
    assert "Traceback" not in done.stderr


INTERRUPTED = """
import sys
from quadctl.cli.main import main

class Impatient:
    def find_spec(self, name, path=None, target=None):
        if name == "quadctl.cli.fast_imports":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Impatient())
main()
"""


def test_ctrl_c_during_imports_exits_with_130_silently():
    done = subprocess.run(
        [sys.executable, "-P", "-c", INTERRUPTED],
        capture_output=True, text=True, check=False, timeout=30,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


LOST = """
import os, signal, sys
from quadctl.cli.main import main

class Impatient:
    def find_spec(self, name, path=None, target=None):
        if name == "quadctl.cli.fast_imports":
            # Python ignores what is raised while it collects an object.
            class Collected:
                def __del__(self):
                    os.kill(os.getpid(), signal.SIGINT)
            Collected()

sys.meta_path.insert(0, Impatient())
sys.argv[1:] = ["type", "show", "goto"]
main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows cannot delay Ctrl-C")
def test_a_ctrl_c_where_python_ignores_exceptions_is_not_lost():
    done = subprocess.run(
        [sys.executable, "-P", "-c", LOST],
        capture_output=True, text=True, check=False, timeout=30,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


WORD = st.text("ab \tcdé", max_size=6)
Capture = pytest.CaptureFixture[str]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ({"b": 1.0, "a": [1, None]}, '{"b":1.0,"a":[1,null]}\n'),
        (CageSize(5.0, 5.0, 2.0), '{"x":5.0,"y":5.0,"z":2.0}\n'),
        ("line\nbreak", '"line\\nbreak"\n'),
        (float("nan"), "null\n"),
        ([], "[]\n"),
    ],
)
def test_a_document_is_one_line_of_json(capsys: Capture, value: object, text: str):
    output.document(value)
    assert capsys.readouterr() == (text, "")


def test_a_table_has_aligned_columns_and_no_trailing_blanks(capsys: Capture):
    output.table([("NAME", "STATE", "PID"), ("hub", "ready", 12), ("dynamics", "down", "-")])
    assert capsys.readouterr().out == (
        "NAME      STATE  PID\n"
        "hub       ready  12\n"
        "dynamics  down   -\n"
    )  # fmt: skip


def test_an_empty_table_prints_nothing(capsys: Capture):
    output.table([])
    assert capsys.readouterr().out == ""


@settings(max_examples=40)
@given(st.lists(st.tuples(WORD, WORD, st.integers()), min_size=1, max_size=5))
def test_a_table_has_one_line_per_row_for_any_text(rows: list[tuple[str, str, int]]):
    kept, sys.stdout = sys.stdout, io.StringIO()
    try:
        output.table(rows)
        lines = sys.stdout.getvalue().split("\n")
    finally:
        sys.stdout = kept
    assert len(lines) == len(rows) + 1
    width = max(len(first) for first, _, _ in rows)
    assert all(
        line[:width].strip() == first.strip()
        for line, (first, _, _) in zip(lines, rows, strict=False)
    )


def test_fields_are_printed_in_the_ros_style(capsys: Capture):
    output.fields({"stamp": 0.5, "position": {"x": 1.0, "y": -2.0}, "reason": "", "empty": {}})
    assert capsys.readouterr().out.splitlines() == [
        "stamp: 0.5",
        "position:",
        "  x: 1.0",
        "  y: -2.0",
        "reason: ''",
        "empty: {}",
    ]


@pytest.mark.parametrize(("value", "text"), [(1.5, "1.5"), ("a b", "a b"), ([1, 2], "[1, 2]")])
def test_one_field_is_printed_alone(capsys: Capture, value: object, text: str):
    output.fields(value)
    assert capsys.readouterr().out == f"{text}\n"


def test_an_error_prints_its_message_and_hint(capsys: Capture):
    output.error(Invalid("what and why", "do this"), as_json=False)
    output.error(QuadctlError("alone"), as_json=False)
    assert capsys.readouterr() == ("", "error: what and why\n  try: do this\nerror: alone\n")


def test_an_error_as_json_has_code_message_and_hint(capsys: Capture):
    output.error(NotReady("no sample", "wait"), as_json=True)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert msgspec.json.decode(captured.err) == {
        "error": {"code": "not_ready", "message": "no sample", "hint": "wait"}
    }


def test_a_note_is_printed_to_stderr(capsys: Capture):
    output.note("by the way")
    assert capsys.readouterr() == ("", "by the way\n")


@pytest.mark.parametrize("quiet", [True, False])
def test_progress_is_hidden_without_a_terminal(capsys: Capture, quiet: bool):
    with Progress("flying", quiet=quiet) as progress:
        progress.update(0.5, "1 m to go")
    assert capsys.readouterr() == ("", "")


def test_terminal_control_characters_are_escaped(capsys: Capture):
    output.fields({"\x1b[31mred": 1})
    output.table([("uav/\x1b]0;title\x07", "a\rb\x9b2J")])
    output.note("say \x1b[1m it")
    assert capsys.readouterr() == (
        "\\x1b[31mred: 1\nuav/\\x1b]0;title\\x07  a\\rb\\x9b2J\n",
        "say \\x1b[1m it\n",
    )


def test_invisible_characters_are_escaped_and_letters_stay(capsys: Capture):
    output.fields("\u202egnp.\u2066\u200b\ufeff\u00ad\U000e0041 \u00fc\u65e5\U0001f681")
    output.table([("uav/\u202ex", "\u061c")])
    output.error(Invalid("a\u200fb"), as_json=False)
    assert capsys.readouterr() == (
        (
            "\\u202egnp.\\u2066\\u200b\\ufeff\\xad\\U000e0041 \u00fc\u65e5\U0001f681\n"
            "uav/\\u202ex  \\u061c\n"
        ),
        "error: a\\u200fb\n",
    )


def test_json_escapes_them_and_has_the_same_value(capsys: Capture):
    value = {"\u202ekey": "\x9b\x7f\U000e0041\n\u00fc\U0001f681"}
    output.document(value)
    output.error(Invalid("a\u200fb"), as_json=True)
    out, err = capsys.readouterr()
    assert out == '{"\\u202ekey":"\\u009b\\u007f\\udb40\\udc41\\n\u00fc\U0001f681"}\n'
    assert msgspec.json.decode(out) == value
    assert '"a\\u200fb"' in err
