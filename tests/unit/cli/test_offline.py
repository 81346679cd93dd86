"""Commands that need no running system."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

from quadctl.schemas.topics import SERVICES, TOPICS
from quadctl.services.runtime.bus.session import free_port
from quadctl.services.runtime.params.catalogue import render
from tests.support.command_line import Quadctl

CALIBRATE = "bool zero\n---\nfloat64 baseline\n"
FIELDS = "  try: `quadctl type show calibrate_pressure` prints the fields\n"


@pytest.mark.parametrize(
    "name",
    [
        *("calibrate", "Calibrate", "CALIBRATE", "calibrate_pressure", "/calibrate_pressure"),
        *("quad/Calibrate", "quad/srv/Calibrate", "CalibrateRequest", "@srv/calibrate_pressure"),
        *("/uav/@srv/calibrate_pressure", "/uav7/calibrate_pressure"),
    ],
)
def test_a_service_type_is_found_by_any_of_its_names(quadctl: Quadctl, name: str):
    assert quadctl("type", "show", name) == (0, CALIBRATE, "")


@pytest.mark.parametrize(
    "name",
    [
        "Waypoint",
        "waypoint",
        "input/position_request",
        "/uav/input/position_request",
        "quad/msg/Waypoint",
    ],
)
def test_a_message_type_is_found_by_any_of_its_names(quadctl: Quadctl, name: str):
    assert quadctl("type", "show", name).out == "float64 x\nfloat64 y\nfloat64 z\n"


@pytest.mark.parametrize(
    ("name", "type_"),
    [
        ("/uav/pose", "Pose"),
        ("uav/info", "Info"),
        ("pressure/get_params", "GetParams"),
        ("/uav/@srv/my/node/set_params", "SetParams"),
        ("get_params", "GetParams"),
        ("Position", "Position"),
        ("velocity", "Velocity"),
        ("quad/CageSize", "CageSize"),
    ],
)
def test_a_type_is_found_by_key_by_service_or_as_a_nested_type(
    quadctl: Quadctl, name: str, type_: str
):
    assert quadctl("type", "show", name, "--json").json["name"] == type_


def test_every_declared_type_can_be_listed_and_shown(quadctl: Quadctl):
    names = quadctl("type", "list").out.splitlines()
    assert names == sorted(names) == quadctl("type", "list", "--json").json
    assert {topic.type.__name__ for topic in TOPICS} <= set(names)
    assert {service.type_name for service in SERVICES} | {"GetParams", "SetParams"} <= set(names)
    for name in (
        *names,
        *(topic.name for topic in TOPICS),
        *(service.name for service in SERVICES),
    ):
        result = quadctl("type", "show", name, "--json")
        assert result.code == 0
        assert result.json["definition"]


def test_a_type_is_shown_as_json(quadctl: Quadctl):
    assert quadctl("type", "show", "calibrate", "--json").json == {
        "name": "Calibrate",
        "definition": CALIBRATE.rstrip(),
    }


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("calibrat", "alibrate?"),
        ("zzzzz", "type list"),
        ("uav/poze", "pose?"),
        ("std_srvs/SetBool", "type list"),
    ],
)
def test_an_unknown_type_is_invalid_with_a_hint(quadctl: Quadctl, name: str, hint: str):
    result = quadctl("type", "show", name, "--json")
    assert (result.code, result.error["code"]) == (6, "invalid")
    assert hint in result.error["hint"]


def test_init_writes_the_file_once(quadctl: Quadctl, tmp_path: Path):
    assert quadctl("init") == (0, "wrote quad.toml\n", "")
    assert (tmp_path / "quad.toml").read_text(encoding="utf-8") == render()
    result = quadctl("init", "--json")
    assert (result.code, result.error["code"]) == (6, "invalid")
    assert "quad.toml already exists" in result.error["message"]
    assert quadctl("init", "my_lab.toml", "--json").json == {"file": "my_lab.toml"}


def pasted(printed: str, file: Path) -> dict[str, Any]:
    """Paste what `init --safety` printed into its file as it says, and return the tables."""
    said, *lines = printed.splitlines()[1:]
    text = file.read_text(encoding="utf-8")
    if "below [processes]" in said:
        text = text.replace("[processes]", "\n".join(["[processes]", *lines]))
    elif "in place of" in said:
        text = "\n".join(lines[0] if "safety =" in line else line for line in text.splitlines())
    else:
        text = "\n".join([text, *lines])
    return tomllib.loads(text)


def test_init_writes_a_safety_node_and_a_file_that_names_it(quadctl: Quadctl, tmp_path: Path):
    assert quadctl("init", "--safety") == (
        0,
        (
            "wrote my_safety.py\n"
            "wrote quad.toml: `quadctl up` runs my_safety.py in place of our own safety\n"
        ),
        "",
    )
    assert (tmp_path / "quad.toml").read_text(encoding="utf-8") == (
        '[processes]\nsafety = "python my_safety.py"\n'
    )
    (tmp_path / "my_safety.py").unlink()
    again = quadctl("init", "--safety").out
    assert again.endswith("`quadctl up` runs it: quad.toml names it\n")
    assert quadctl("init", "--safety", "second.py", "--json").json == {"file": "second.py"}


@pytest.mark.parametrize(
    "text",
    [
        "[safety]\ntakeoff = 2.0\n",
        "[processes]\n# none yet\n[safety]\ntakeoff = 2.0\n",
        "[processes]\nsafety = 'python other.py'\nidle = 'sleep 9'\n",
        render(),
    ],
)
def test_init_prints_toml_for_a_file_that_exists(quadctl: Quadctl, tmp_path: Path, text: str):
    file = tmp_path / "quad.toml"
    file.write_text(text, encoding="utf-8")
    printed = quadctl("init", "--safety", "my node.py").out
    assert file.read_text(encoding="utf-8") == text
    before, after = tomllib.loads(text), pasted(printed, file)
    processes = before.pop("processes", {}) | {"safety": "python 'my node.py'"}
    assert after == before | {"processes": processes}


def test_init_leaves_a_broken_file_alone(quadctl: Quadctl, tmp_path: Path):
    (tmp_path / "quad.toml").write_text("[processes", encoding="utf-8")
    result = quadctl("init", "--safety")
    assert result.code == 0
    assert "quad.toml is left as it was: quad.toml is not TOML" in result.out


def test_init_reports_an_unwritable_path(quadctl: Quadctl):
    result = quadctl("init", "nowhere/quad.toml")
    assert result.code == 6
    assert "nowhere/quad.toml cannot be written: No such file or directory\n" in result.err


NEEDS_A_RUN = [
    "status", "ps", "down", "state", "hold", "reset", "calibrate", "cage on", "cage off",
    "cage show", "goto 1 2 1", "topic list", "topic echo pose", "service list",
    "service info goto", "service call calibrate_pressure zero=true", "param list",
    "param get safety.cage_on", "param set safety.takeoff 1", "param dump", "param dump -o x.toml",
    "param diff", "param load quad.toml", "param save quad.toml",
    "param set supervise.answer_timeout 3", "node list", "node info safety", "node ping safety",
    "node ping --all", "node logs", "node logs safety -f", "node kill safety", "record",
    "plot --live", "fleet list", "fleet hold", "fleet land-all", "fleet goto 0 0 1",
    "bridge foxglove --port PORT", "bridge mavlink", "bridge ros2",
]  # fmt: skip


@pytest.mark.parametrize("line", NEEDS_A_RUN)
def test_without_a_run_the_exit_code_is_3_and_no_file_is_written(
    quadctl: Quadctl, tmp_path: Path, line: str
):
    file = tmp_path / "quad.toml"
    file.write_text("[safety]\ntakeoff = 2.0\n", encoding="utf-8")
    # Another program may have the port that is usual.
    result = quadctl(*line.replace("PORT", str(free_port())).split(), "--json")
    assert (result.code, result.out) == (3, "")
    assert result.error["code"] == "unreachable"
    assert "quadctl up" in result.error["hint"]
    assert list(tmp_path.iterdir()) == [file]
    assert file.read_text(encoding="utf-8") == "[safety]\ntakeoff = 2.0\n"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("service call calibrat True",
         "error: there is no service calibrat\n  try: did you mean calibrate_pressure?\n"),
        ("service call calibrate_pressure",
         f"error: not a valid CalibrateRequest: Object missing required field `zero`\n{FIELDS}"),
        ("service call calibrate_pressure zero=3",
         "error: not a valid CalibrateRequest: Expected `bool`, got `int` - at `$.zero`\n" + FIELDS),
        ("type show Waypont",
         "error: there is no type Waypont\n  try: did you mean waypoint?\n"),
        ("goto 1 2 nan",
         "error: z = nan is not a valid coordinate\n  try: coordinates are metres, finite, and at most 10 km from the origin\n"),
    ],
)  # fmt: skip
def test_an_invalid_word_is_named_with_the_next_step(quadctl: Quadctl, line: str, said: str):
    assert quadctl(*line.split()) == (6, "", said)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("fleet list --fleet /dev/full", "fleet"),
        ("fleet hold --fleet none.toml", "none.toml"),
        ("service call calibrate_pressure zero=true more=1", "unknown field `more`"),
        ("up none.toml", "none.toml cannot be read"),
        ("up --set safety.takeof=3", "did you mean safety.takeoff?"),
        ("up --set safety.takeoff=nan", "safety.takeoff"),
        ("up --without safty", "safty"),
        ("service call goto x=1", "missing required field `y`"),
        ("service call goto x=1 y=2 z=nan", "$.z"),
        ("service call goto 1 2 3 true false false 5", "goto takes 6 values"),
        ('service call goto {"x":', "not JSON"),
        ("goto 1 2 3 --arrive 0", "--arrive 0"),
    ],
)
def test_invalid_arguments_are_exit_6_before_any_call(quadctl: Quadctl, line: str, message: str):
    result = quadctl(*line.split())
    assert (result.code, result.out) == (6, "")
    assert message.lower() in result.err.lower()


@pytest.mark.parametrize(
    "arguments",
    ["zero=true", "zero=True", "True", "true", '{"zero":true}', "zero: true"],
)
def test_a_request_may_be_written_as_in_ros(quadctl: Quadctl, arguments: str):
    result = quadctl("service", "call", "/calibrate_pressure", arguments, "--json")
    assert (result.code, result.error["code"]) == (3, "unreachable")


@pytest.mark.parametrize(
    "line",
    [
        "/calibrate_pressure Calibrate {zero:true}",
        "/calibrate_pressure quad/Calibrate zero=true",
        "/calibrate_pressure std_srvs/srv/SetBool true",
        "pressure/get_params GetParams {names:[]}",
        "/hold std_srvs/srv/Trigger",
        "hold Hold",
    ],
)
def test_a_type_before_a_request_is_ignored(quadctl: Quadctl, line: str):
    result = quadctl("service", "call", *line.split(), "--json")
    assert (result.code, result.error["code"]) == (3, "unreachable")


@pytest.mark.parametrize(
    ("line", "hint"),
    [
        ("goto 1,5 0 1", "1.5: a number has a point"),
        ("goto 0 0 1 --arrive 5,0", "5.0: a number has a point"),
        ("goto 1, 0, 1", "1: without a comma"),
        ("goto 1,2,1", "`quadctl goto 1 2 1`: without commas"),
        ("param set safety.zones [1, 2]", "`quadctl param set safety.zones '[1, 2]'`"),
        ("param set dynamics.start {x: 1, y: 2}", "`quadctl param set dynamics.start '{x: 1, y: 2}'`"),
    ],
)  # fmt: skip
def test_a_word_as_other_tools_take_it_gets_the_line_to_type(
    quadctl: Quadctl, line: str, hint: str
):
    result = quadctl(*line.split(), "--json")
    assert (result.code, result.out) == (2, "")
    assert hint in result.error["hint"]
