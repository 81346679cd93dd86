"""Verdicts of doctor: each check with facts for PASS, WARN and FAIL."""

from typing import Any

import pytest
from msgspec.structs import replace
from packaging.requirements import Requirement

from quadctl.cli.doctor import bus, host, installation, run
from quadctl.cli.doctor.check import Finding, failed, passed, text_of, warned, with_options
from quadctl.cli.doctor.host import MB, DiskSpace, Folder, Neighbours, ProcessFacts
from quadctl.cli.doctor.installation import Installed
from quadctl.cli.doctor.run import Settings
from quadctl.services.runtime.errors import Invalid, Unreachable
from quadctl.services.runtime.run_files import ProcessRecord, RunState

INSTALLED = Installed(
    "3.11.7", "built with a profile", ">=3.11", {"numpy": "2.2.0"}, [Requirement("numpy<3,>=2.2")], "/ours",
    "/ours", "/ours", [], [],
)  # fmt: skip
READY = ProcessRecord("pressure", 7, "ready", 0)
RUN = RunState("lab", 5, ["uav"], [READY])
LIVE = Folder("/run/lab", 0o700, True, "5", False, True, RUN, {})
GONE = LIVE._replace(live=False, run=None, mode=None, holder="", socket=False)
ALONE = Neighbours("/run", [], [])
FINE = Settings("./quad.toml", {"safety.takeoff": 1.0, "safety.cage_on": True})


def verdict(check: Finding) -> str:
    """Return the verdict; a check that does not pass by its own fault must have a fix."""
    assert check.name
    assert check.evidence
    assert check.fix or check.verdict == "PASS" or "not checked" in check.evidence
    return check.verdict


@pytest.mark.parametrize(
    ("expected", "check", "changes"),
    [
        ("PASS", installation.python, {}),
        ("FAIL", installation.python, {"python": "3.10.14"}),
        ("PASS", installation.packages, {}),
        ("FAIL", installation.packages, {"versions": {"numpy": "1.26.4"}}),
        ("FAIL", installation.packages, {"versions": {"numpy": "3.0.0"}}),
        ("FAIL", installation.packages, {"versions": {"numpy": None}}),
        ("FAIL", installation.packages, {"versions": {"numpy": "nonsense"}}),
        ("PASS", installation.packages, {"versions": {"numpy": "2.4rc1"}}),
        ("PASS", installation.imports, {}),
        ("WARN", installation.imports, {"here": "/home/student"}),
        ("FAIL", installation.imports, {"found": "/elsewhere"}),
        ("FAIL", installation.imports, {"found": ""}),
        ("FAIL", installation.imports, {"claimed": ["other"]}),
        ("FAIL", installation.imports, {"altered": ["quadctl/cli/main.py"]}),
    ],
)
def test_the_installation_is_checked(expected: str, check: Any, changes: dict[str, Any]):
    assert verdict(check(INSTALLED._replace(**changes))) == expected


@pytest.mark.parametrize(
    ("prefix", "options", "said"),
    [
        ("/usr", "'--enable-shared'", "the distribution's build"),
        ("/opt/python", "'--enable-optimizations' '--with-lto'", "built with a profile"),
        ("/opt/pyenv/versions/3.11.7", "'--enable-shared'", "built without a profile: "),
        (r"C:\Python311", None, "the installer's build"),
    ],
)
def test_the_build_of_the_interpreter_is_named(prefix: str, options: str | None, said: str):
    found = installation.build(prefix, options)
    assert found.startswith(said)
    evidence = installation.python(INSTALLED._replace(build=found)).evidence
    assert evidence == f"3.11.7, {found}"


def test_environment_variables_are_checked():
    assert installation.environment({"HOME": "/"}).verdict == "PASS"
    assert "QUADCTL_REALM=lab" in installation.environment({"QUADCTL_REALM": "lab"}).evidence
    assert verdict(installation.environment({"PYTHONDONTWRITEBYTECODE": "1"})) == "WARN"


@pytest.mark.parametrize(
    ("expected", "disks"),
    [
        ("PASS", [DiskSpace("/a", int(300 * MB)), DiskSpace("/b", int(900 * MB))]),
        ("WARN", [DiskSpace("/a", int(300 * MB)), DiskSpace("/b", int(199 * MB))]),
        ("FAIL", [DiskSpace("/a", int(9 * MB)), DiskSpace("/b", int(900 * MB))]),
        ("FAIL", [DiskSpace("/a", int(900 * MB)), DiskSpace("/b", int(900 * MB), "read-only")]),
    ],
)
def test_full_and_read_only_disks_are_found(expected: str, disks: list[DiskSpace]):
    assert verdict(host.disk(disks)) == expected


def test_a_clock_at_1970_fails():
    assert [verdict(host.clock(year)) for year in (2026, 1970)] == ["PASS", "FAIL"]


@pytest.mark.parametrize(
    ("expected", "text", "seconds", "memory"),
    [
        ("PASS", "50% of a core, 20 MB", 1.0, 20 * MB),
        ("WARN", "safety takes 95% of a core", 1.9, 20 * MB),
        ("WARN", "safety takes 250 MB", 0.1, 250 * MB),
        ("PASS", "not known", 0.0, 0),
    ],
)
def test_processor_and_memory_use_is_checked(
    expected: str, text: str, seconds: float, memory: float
):
    before, after = ProcessFacts("S", 3.0), ProcessFacts("S", 3.0 + seconds, int(memory))
    found = host.load({"safety": before}, {"safety": after}, 2.0)
    assert verdict(found) == expected
    assert text in found.evidence


@pytest.mark.parametrize(
    ("expected", "text", "found"),
    [
        ("PASS", "supervised by process 5", LIVE),
        ("FAIL", "mode 0755", LIVE._replace(mode=0o755)),
        ("FAIL", "process 9 holds", LIVE._replace(holder="9")),
        ("FAIL", "the vehicle cat", LIVE._replace(run=replace(RUN, vehicles=["cat"]))),
        ("FAIL", "hub.sock is gone", LIVE._replace(socket=False)),
        ("WARN", "just starting", LIVE._replace(run=None)),
        ("WARN", "by hand", LIVE._replace(live=False, by_hand=True)),
        ("FAIL", "has died", LIVE._replace(live=False)),
        ("WARN", "nothing is running in lab", GONE),
    ],
)
def test_the_realm_is_checked(expected: str, text: str, found: Folder):
    check = run.realm("lab", found, ALONE, "uav", ProcessFacts("S"))
    assert verdict(check) == expected
    assert text in check.evidence


def test_a_frozen_supervisor_fails_with_the_command_to_resume_it():
    check = run.realm("lab", LIVE, ALONE, "uav", ProcessFacts("T"))
    assert (verdict(check), check.fix.split("`")[1]) == ("FAIL", "kill -CONT 5")


def test_without_a_run_the_running_realms_are_named():
    check = run.realm("lab", GONE, ALONE._replace(live=["mine"]), "uav")
    assert check.evidence == "nothing is running in lab, but in mine"
    (shown,) = with_options([check], "--realm lab")
    assert "`quadctl up -d --realm lab`" in shown.fix
    assert "`quadctl doctor --realm mine`" in shown.fix


def test_leftover_folders_are_found():
    assert verdict(run.leftovers(ALONE)) == "PASS"
    left = run.leftovers(Neighbours("/run", ["a"], ["b", "c"]))
    assert (verdict(left), left.fix) == ("WARN", "`rm -r /run/b /run/c`")


CRASH = """\
flying
Traceback (most recent call last):
  File "mine.py", line 3, in <module>
    1 / 0
ZeroDivisionError: division by zero
up: pressure ended (exit 1): restarting in 0.1 s
flying
"""
HANDLED = """\
up: pressure ended (exit 1): restarting in 0.1 s
Traceback (most recent call last):
  File "mine.py", line 3, in step
ValueError: once

During handling of the above exception, another exception occurred:

Traceback (most recent call last):
  File "mine.py", line 5, in step
KeyError: 'twice'
up: pressure: no answer for 2 s: killed
"""


@pytest.mark.parametrize(
    ("log", "why"),
    [
        ("", ""),
        ("flying\n", ""),
        ("up: pressure: restart requested\n", "pressure: restart requested"),
        (
            CRASH,
            "ZeroDivisionError: division by zero; pressure ended (exit 1): restarting in 0.1 s",
        ),
        (HANDLED, "KeyError: 'twice'; pressure: no answer for 2 s: killed"),
        (
            CRASH
            + "up: pressure: no answer for 2 s: killed\nup: pressure ended (SIGKILL): left down\n",
            "pressure: no answer for 2 s: killed; pressure ended (SIGKILL): left down",
        ),
        (CRASH + "up: pressure ended (exit 2): left down", "pressure ended (exit 2): left down"),
        (CRASH + "up: pressure: restart requested\n", "pressure: restart requested"),
    ],
)
def test_the_cause_of_a_restart_is_the_last_exception_and_the_supervisors_line(log: str, why: str):
    assert run.ending(log.splitlines()) == why
    check = run.node(replace(READY, restarts=1), ProcessFacts("S"), log.splitlines())
    assert check.evidence.endswith(f"restarted once: {why}" if why else "restarted once")


@pytest.mark.parametrize(
    ("expected", "text", "state", "restarts", "process"),
    [
        ("PASS", "ready, process 7", "ready", 0, "S"),
        ("WARN", "restarted once", "ready", 1, "R"),
        ("WARN", "restarted 3 times", "ready", 3, "?"),
        ("WARN", "restarting", "restarting", 1, ""),
        ("FAIL", "frozen", "ready", 0, "T"),
        ("FAIL", "has died", "ready", 0, "Z"),
        ("FAIL", "has died", "ready", 0, ""),
        ("FAIL", "no wings", "down", 4, ""),
    ],
)
def test_each_node_state_has_its_verdict(
    expected: str, text: str, state: Any, restarts: int, process: str
):
    record = replace(READY, state=state, restarts=restarts)
    check = run.node(record, ProcessFacts(process), ["no wings"])
    assert verdict(check) == expected
    assert text in check.evidence
    assert expected == "PASS" or "pressure" in check.fix


@pytest.mark.parametrize(
    ("expected", "found", "running"),
    [
        ("PASS", FINE, {"safety.takeoff": 1, "safety.cage_on": True, "mine.gain": 3}),
        ("WARN", FINE, {"safety.takeoff": 2.0}),
        ("WARN", FINE, {}),
        ("WARN", FINE._replace(error=Invalid("wrong")), {"safety.takeoff": 1.0}),
    ],
)
def test_parameters_that_differ_from_the_file_are_warned_about(
    expected: str, found: Settings, running: dict[str, Any]
):
    assert verdict(run.parameters(found, running)) == expected


def test_the_list_of_differing_parameters_is_short():
    many = {f"safety.p{number}": number for number in range(9)}
    check = run.parameters(Settings("the defaults", dict.fromkeys(many, -1)), many)
    assert "safety.p0 is 0, there -1" in check.evidence
    assert check.evidence.endswith("and 4 more")
    assert "param load" not in check.fix


def test_a_wrong_parameter_file_fails():
    assert verdict(run.parameter_file(FINE)) == "PASS"
    wrong = FINE._replace(error=Invalid("quad.toml: unknown parameter x", "did you mean y?"))
    check = run.parameter_file(wrong)
    assert verdict(check) == "FAIL"
    assert (check.evidence, check.fix) == (wrong.error.message, wrong.error.hint)


def test_without_an_answer_of_the_hub_no_check_passes():
    checks = list(bus.bus(Unreachable("nothing answers", "start it"), None, FINE, "uav"))
    assert [check.verdict for check in checks] == ["FAIL"] + ["WARN"] * (len(checks) - 1)
    assert checks[0].fix == "start it"
    assert {check.evidence for check in checks[1:]} == {"not checked: the hub does not answer"}


def test_a_check_is_formatted_as_text():
    assert text_of(passed("hub answers", "0.4 ms")) == "PASS  hub answers: 0.4 ms"
    assert text_of(failed("node x", "down:\nlast\nwords", "`a`")).splitlines() == [
        "FAIL  node x: down:", "      last", "      words", "      try: `a`",
    ]  # fmt: skip
    assert with_options([warned("a", "b", "`quadctl up`, `ls`")], "") == [
        warned("a", "b", "`quadctl up`, `ls`")
    ]
