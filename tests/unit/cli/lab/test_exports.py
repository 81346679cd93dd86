"""Exports of a class: the hand-in of each student, and nothing that a student's own archive could pass for."""

import os
from pathlib import Path

import pytest

from quadctl.cli.lab.exports import handins_in
from quadctl.cli.lab.handin import nodes_in, unpacked
from quadctl.services.runtime.errors import Invalid
from tests.support.archives import LAB, below, folder, replaced, zipped

WORK, SAFE, PRESSED = zipped(below("mylab")), LAB["my_safety.py"], b"print('pressure')\n"
BROKEN = replaced(zipped(method=0), b"safe", b"cafe")
METADATA = b"""---
submission_7:
  :submitters:
  - :name: 'Ada O''Neil'
    :sid: '1'
  - :name: "Bob \\u00d6"
    :sid: '2'
  :created_at: 2026-11-01 10:00:00.000000000 Z
  :history:
  - :id: 5
    :name: nobody
submission_8:
  :submitters:
  - :name: Cleo
submission_9:
  :submitters:
  - :name: Cleo
submission_10:
  :submitters:
  - :name: Dora
"""

GRADESCOPE = (
    {"submission_metadata.yml": METADATA} | below("submission_7") | {"submission_8/a.zip": WORK}
    | below("submission_9") | below("submission_11")
)  # fmt: skip
EXPORTS: dict[str, tuple[dict[str, bytes], dict[str, str]]] = {
    "Moodle": (
        {
            "Ada Ö_12_assignsubmission_file_/work.zip": WORK, "Bob_13_assignsubmission_file/mylab/quad.toml": LAB["quad.toml"],
            "Bob_13_assignsubmission_file/mylab/my_safety.py": SAFE, "Cleo_14_assignsubmission_onlinetext/onlinetext.html": b"x",
            "Dora_15_assignsubmission_file/a.zip": BROKEN, "Ed_16_assignsubmission_file_/": b"",
        },
        {"Ada Ö_12": "", "Bob_13": "", "Cleo_14": "neither", "Dora_15": "damaged", "Ed_16": "it is empty"},
    ),
    "Moodle in one folder": (
        {
            "Ada_12_assignsubmission_file_my_safety.py": SAFE, "Ada_12_assignsubmission_file_my_pressure.py": PRESSED,
            "Bob_B_13_assignsubmission_file_a.zip": WORK,
        },
        {"Ada_12": "", "Bob_B_13": ""},
    ),
    "Canvas": (
        {
            "oadaö_12_901_mylab.zip": WORK, "bob2_LATE_13_902_my_safety-1.py": SAFE, "bob2_LATE_13_903_my_pressure-2.py": PRESSED,
            "cleo_14_text.html": b"x", "LATE_anon_aB3_904_work.zip": WORK, "dora_15_905_work.zip": BROKEN, "ed_16_906_7_8_a.zip": WORK,
        },
        {"oadaö_12": "", "bob2_13": "", "cleo_14": "neither", "anon_aB3": "", "dora_15": "damaged", "ed_16": ""},
    ),
    "Gradescope": (
        GRADESCOPE,
        {"Ada O'Neil, Bob Ö": "", "Cleo submission_8": "", "Cleo submission_9": "", "Dora": "it is empty", "submission_11": ""},
    ),
    "Gradescope in a folder": (
        below("assignment_1_export", GRADESCOPE),
        {"Ada O'Neil, Bob Ö": "", "Cleo submission_8": "", "Cleo submission_9": "", "Dora": "it is empty", "submission_11": ""},
    ),
    "archives": (
        {"anna.zip": WORK, "bob.zip": BROKEN, "points.csv": b"x", "cleo/a.pdf": b"x"},
        {"anna.zip": "", "bob.zip": "damaged", "cleo": "neither"},
    ),
    "folders": (below("class", below("anna") | below("bob", {"src/my_safety.py": SAFE})), {"anna": "", "bob": ""}),
    "folders with an archive": ({"anna/a.zip": WORK, "bob/a.zip": WORK, "bob/../x": b""}, {"anna": "", "bob": "outside"}),
}  # fmt: skip


def outcome(path: Path, own: Path) -> dict[str, str]:
    """Return what becomes of each hand-in: nothing, or why it is refused."""
    found = {}
    for number, handin in enumerate(handins_in(path)):
        copy = own / str(number)
        copy.mkdir(parents=True)
        assert Path(handin.name).parent == path
        try:
            found[Path(handin.name).name] = "" if nodes_in(unpacked(handin, copy)) else "no node"
        except Invalid as problem:
            found[Path(handin.name).name] = problem.message
    return found


@pytest.mark.parametrize("form", ["zip", "folder"])
@pytest.mark.parametrize("name", EXPORTS)
def test_each_student_of_an_export_has_a_hand_in(name: str, form: str, tmp_path: Path):
    files, expected = EXPORTS[name]
    path = tmp_path / "export.zip"
    if form == "zip":
        path.write_bytes(zipped(files))
    else:
        inside = {
            each: data
            for each, data in files.items()
            if not each.endswith("/") and ".." not in each
        }
        folder(path, inside)
        for each in files.keys() - inside.keys():
            (path / each.partition("/")[0]).mkdir(exist_ok=True)
    found = outcome(path, tmp_path / "own")
    assert found.keys() == expected.keys()
    for student, cause in expected.items():
        if form == "folder" and cause == "outside":
            continue
        assert bool(found[student]) == bool(cause), found
        assert cause in found[student]


ALONE: dict[str, dict[str, bytes]] = {
    "lab": LAB,
    "lab in a folder": below("mylab"),
    "lab and an older one": LAB | below("old") | below("older"),
    "lab and archives": LAB | {"a.zip": WORK, "b.zip": WORK},
    "nodes and older ones": {"my_safety.py": SAFE} | below("old") | below("older"),
    "lab beside other folders": below("src") | {"docs/a.md": b"", "data.zip": WORK},
    "one archive": {"Ada_12/work.zip": WORK},
    "nothing": {},
}


@pytest.mark.parametrize("name", ALONE)
def test_what_is_not_clearly_a_class_is_one_hand_in(name: str, tmp_path: Path):
    path = tmp_path / "anna.zip"
    path.write_bytes(zipped(ALONE[name]))
    (found,) = handins_in(path)
    assert (found.name, found.members) == (str(path), None)


def test_a_student_has_a_name_that_can_be_written(tmp_path: Path):
    for name in (b"\xfcmit", b"\xf6mit", b"ada", b"ada\nbob: 37 of 37"):
        folder(tmp_path / "class" / os.fsdecode(name))
    assert [each.name for each in handins_in(tmp_path / "class")] == [
        f"{tmp_path}/class/ada", f"{tmp_path}/class/ada\\nbob: 37 of 37", f"{tmp_path}/class/\\udcf6mit", f"{tmp_path}/class/\\udcfcmit",
    ]  # fmt: skip


def test_a_damaged_export_is_one_hand_in_that_says_so(tmp_path: Path):
    path = tmp_path / "export.zip"
    path.write_bytes(zipped(EXPORTS["Canvas"][0])[:-30])
    (found,) = handins_in(path)
    with pytest.raises(Invalid, match="damaged"):
        unpacked(found, tmp_path)
