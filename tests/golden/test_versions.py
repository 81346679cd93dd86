"""Commands of this version and of a newer one on each other's systems, and of versions that do not fit.

The other version is a changed copy of the package, in processes of its own.
"""

import json
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

import quadctl
from quadctl.schemas.messages import SafetyState
from tests.golden.shapes import MISSION
from tests.support.changed_copy import NEWER, OTHER, changed_copy
from tests.support.lab import PATIENT, Lab, private_lab
from tests.support.running import Done, eventually

OURS = ""
"""Path for PYTHONPATH with which the package of this checkout is imported."""
LINES = (
    "status",
    "state",
    "topic list",
    "topic info pose",
    "topic echo pose -n 1",
    "topic echo safety/state -n 1",
    "topic hz pose -n 4",
    "service list",
    "service info goto",
    "service call hold",
    "node list",
    "calibrate",
    "cage show",
    "cage off",
    "cage on",
    "goto 0.3 0 1 --replace",
    "fleet goto 0 0 1 --replace",
    "param list",
    "param get safety.takeoff",
    "param set safety.acceptance_range 0.4",
    "param dump -o dumped.toml",
    "param diff dumped.toml",
    "param load dumped.toml",
    "param save dumped.toml",
    "record -d 0.3 -o here.mcap",
    "bag check here.mcap",
    "replay here.mcap --realm other",
    "fuzz --payloads 20",
    "doctor",
    "reset",
)
PROGRAM = """
import quadctl
with quadctl.connect() as quad:
    assert quad.goto(0.2, 0, 1, replace=True).distance < 0.5
    assert [pose.seq for pose in quad.watch("pose", seconds=0.3)]
    quad.params["safety.acceptance_range"] = 0.3
    quad.cage(on=True), quad.calibrate(), quad.hold(), quad.pressure(), quad.state()
"""
STATE_AND_POSE = {*SafetyState.__struct_fields__, "pose"}
Sides = tuple[Lab, str]
"""A running system of one version, and the path of the package of a client."""


@contextmanager
def system(path: str, client: str, *settings: str) -> Iterator[Lab]:
    """Start a system of the package at a path, with a sensor of the client's."""
    with private_lab() as lab:
        lab.environment["PYTHONPATH"] = path
        sensor = f"env PYTHONPATH={client} {sys.executable} -P -m quadctl.services.pressure"
        file = lab.file(f'[processes]\npressure = "{sensor}"\n')
        lab.start(file, "--set", "dynamics.start.z=1", *PATIENT, *settings)
        yield lab


def both_ways(other: str, ours: bool) -> tuple[str, str]:
    """Return the paths of a system and a client, of which one is this checkout's."""
    return (other, OURS) if ours else (OURS, other)


@pytest.fixture(scope="module")
def newer(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(changed_copy(tmp_path_factory.mktemp("newer"), NEWER))


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(changed_copy(tmp_path_factory.mktemp("other"), OTHER))


@pytest.fixture(scope="module", params=[True, False], ids=["our client", "our system"])
def sides(request: pytest.FixtureRequest, newer: str) -> Iterator[Sides]:
    place, client = both_ways(newer, request.param)
    with system(place, client) as lab:
        yield lab, client


def asked(sides: Sides, *words: object) -> Done:
    lab, client = sides
    return lab.quadctl(*words, "--json", PYTHONPATH=client)


def check(doctor: Done) -> tuple[str, str]:
    """Return what `doctor` says about schemas."""
    (schemas,) = (each for each in doctor.json["checks"] if each["name"] == "schemas")
    return schemas["verdict"], schemas["evidence"]


@pytest.mark.thorough
def test_commands_work_with_the_other_version(sides: Sides):
    done = {line: asked(sides, *line.split()) for line in LINES}
    assert not {line: ended for line, ended in done.items() if ended.code}
    verdict, evidence = check(done["doctor"])
    assert verdict == "PASS"
    assert "Pose#" in evidence


def test_programs_work_with_the_other_version(sides: Sides):
    lab, client = sides
    done = lab.run([sys.executable, "-P", "-c", PROGRAM], PYTHONPATH=client)
    assert (done.code, done.err) == (0, "")


def test_a_field_that_the_other_version_lacks_has_its_default(sides: Sides):
    _, client = sides
    pose = asked(sides, "topic", "echo", "pose", "-n", 1).json
    state = asked(sides, "state").json
    if client == OURS:
        assert "gust" not in pose
        assert state.keys() == STATE_AND_POSE
    else:
        assert (pose["gust"], state["battery"], state["nearest"]["side"]) == (0.5, 7, "north")


def test_a_new_field_of_a_request_is_refused_where_it_is_unknown(sides: Sides):
    _, client = sides
    goal = ("service", "call", "goto", "x=0.1", "y=0", "z=1", "replace=true")
    if client == OURS:
        assert asked(sides, *goal).json == {"accepted": True, "reason": ""}
        return
    assert asked(sides, *goal, "gently=false").json["expected"] == 2.5
    count = asked(sides, "state").json["request"]
    refused = asked(sides, *goal, "gently=true")
    assert refused.code == 6
    assert "unknown field `gently`" in refused.err
    assert "the sender's quadctl is newer" in refused.err
    assert asked(sides, "state").json["request"] == count


@pytest.mark.thorough
def test_a_recording_keeps_the_fields_of_the_other_version(sides: Sides):
    lab, client = sides
    file = lab.folder / "kept.mcap"
    assert asked(sides, "record", "-d", 0.3, "-o", file).code == 0
    poses = quadctl.read(file)["uav/pose"]
    assert ("gust" in poses) is (client == OURS), "the system's own fields, no more and no less"
    for reader in (client, lab.environment["PYTHONPATH"]):
        checked = lab.quadctl("bag", "check", file, "--json", PYTHONPATH=reader)
        assert (checked.code, checked.json["ok"]) == (0, True)


@pytest.mark.thorough
@pytest.mark.parametrize("ours", [True, False], ids=["our client", "our system"])
def test_a_mission_is_flown_by_nodes_of_two_versions(newer: str, ours: bool):
    place, client = both_ways(newer, ours)
    with system(place, client, "--set", "dynamics.speed=0") as lab:
        file = lab.file(MISSION, "mission.toml")
        flown = lab.quadctl("fly", file, "--json", PYTHONPATH=client)
        assert flown.code == 0, flown
        verdicts = [row["accepted"] for row in flown.json["rows"]]
        assert verdicts == [True, True, True, False, True, True]
        assert flown.json["counts"] == {"poses": 51, "transitions": 7, "pressure": 6}


@pytest.mark.thorough
@pytest.mark.parametrize("ours", [True, False], ids=["our client", "our system"])
def test_versions_that_do_not_fit_refuse_each_other(other: str, ours: bool):
    place, client = both_ways(other, ours)
    with system(place, client) as lab:
        count = lab.quadctl("state", "--json").json["request"]
        lines = "topic echo pose -n 1", "service call goto x=1 y=0 z=1", "service call hold"
        for line, type_ in zip(lines, ("Pose", "GotoRequest", "HoldResponse"), strict=True):
            done = asked((lab, client), *line.split(), "--timeout", 1)
            error = json.loads(done.err.splitlines()[-1])["error"]
            assert (done.code, error["code"]) == (6, "invalid"), done
            hashed = f"{type_}#........"
            both = f"schema mismatch: the sender has {hashed}, this side has {hashed}"
            assert re.search(both, error["message"]), error
            assert "same version" in error["hint"]
        assert lab.quadctl("state", "--json").json["request"] == count
        verdict, evidence = check(asked((lab, client), "doctor"))
        assert verdict == "FAIL"
        assert "dynamics has Pose#" in evidence
        eventually(lambda: "schema mismatch" in lab.log("pressure"))
