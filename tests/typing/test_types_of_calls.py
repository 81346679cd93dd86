"""Types that mypy and pyright infer for topics and services, and the errors that they report."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# Each comment is what mypy must report for its line: a revealed type, or an error's code. `misc`
# means that no type fits both the service and the request.
PROGRAM = """\
from quadctl.schemas.messages import Pose, Pressure
from quadctl.schemas.services import CalibrateRequest, CalibrateResponse, GotoRequest, HoldRequest
from quadctl.schemas.topics import CALIBRATE, GOTO, HOLD, POSE, PRESSURE, STATE, get_params
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.bus import codec

def handler(request: CalibrateRequest) -> CalibrateResponse:
    return CalibrateResponse(0.0)

def on_pose(pose: Pose) -> None: ...

def node(node: Node) -> None:
    reveal_type(node.listen(POSE).value)  # Pose | None
    reveal_type(node.listen(PRESSURE).age)  # float
    node.listen(POSE).value.seq  # [union-attr]
    node.listen(POSE, on_pose)
    node.listen(PRESSURE, on_pose)  # [arg-type]
    node.serve(CALIBRATE, handler)
    node.serve(GOTO, handler)  # [arg-type]
    node.publisher(POSE).put(Pressure(0.0, 0.0, 0.0, 0, 0.0))  # [arg-type]

def client(client: Client) -> None:
    reveal_type(client.call(CALIBRATE, CalibrateRequest(True)))  # CalibrateResponse
    reveal_type(client.call(GOTO, GotoRequest(1, 2, 3)).accepted)  # bool
    reveal_type(client.latest(STATE).state)  # Literal['HOVERING'] | Literal['VERIFYING'] | Literal['MOVING']
    reveal_type(client.first(POSE).position.x)  # float
    client.call(CALIBRATE, GotoRequest(1, 2, 3))  # [misc]
    client.call(HOLD, CalibrateRequest(True))  # [misc]
    client.call(get_params("safety"), HoldRequest())  # [misc]
    client.call(CALIBRATE, CalibrateRequest("yes"))  # [arg-type]
    client.call(CALIBRATE, CalibrateRequest(zero=True)).zero  # [attr-defined]
    GotoRequest(1, 2)  # [call-arg]

def decoded(payload: bytes) -> None:
    reveal_type(codec.decode(Pose, payload, ""))  # Pose
"""

API = """\
import quadctl

with quadctl.launch(params={"dynamics.speed": 0}, vehicles=1) as run:
    quad = run.vehicle
    reveal_type(quad.goto(1, 2, 1).distance)  # float
    flight = quad.goto(2, 2, 1, replace=True, wait=False)
    reveal_type(flight.arrived)  # bool
    reveal_type(flight.wait())  # quadctl.vehicle.Arrival
    reveal_type(quad.calibrate().samples)  # int
    reveal_type(quad.settle(timeout=5).stamp)  # float
    reveal_type(quad.pose().position.x)  # float
    reveal_type([m.pressure for m in quad.watch("pressure", seconds=2)])  # list[float]
    reveal_type(quad.watch("pose").lost)  # int
    quad.goto(1, 2)  # [call-overload]
    quad.cage(False)  # [call-arg]
    quad.land()  # [attr-defined]
    quadctl.launch(parameters={})  # [call-arg]
quadctl.nosuch  # [attr-defined]
try:
    reveal_type(quadctl.connect(timeout=1.0).name)  # str
except quadctl.Refused as refusal:
    reveal_type(refusal.reason)  # str
except quadctl.Error as error:
    reveal_type(error.exit_code)  # int
reveal_type(quadctl.read("flight.mcap")["uav/pose"]["position"].shape)  # tuple[Any, ...]
"""


@pytest.mark.thorough
@pytest.mark.parametrize("text", [PROGRAM, API], ids=["bus", "api"])
def test_mypy_infers_the_types_of_calls_and_finds_their_mistakes(tmp_path: Path, text: str):
    program = tmp_path / "program.py"
    program.write_text(text)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--no-error-summary", "--no-pretty", str(program)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    said: dict[int, str] = {}
    for line in done.stdout.splitlines():
        if ": note: " in line and "Revealed type" not in line:
            continue  # more about the error of the line before
        found = re.match(
            r'.*program\.py:(\d+): (?:note: Revealed type is "(.*)"|error: .*(\[.*\]))$', line
        )
        assert found, line
        revealed = re.sub(r"\b(?:builtins|quadctl\.schemas\.\w+)\.", "", found[2] or "")
        said[int(found[1])] = revealed or found[3]
    assert said == expected(text), done.stderr


def expected(text: str) -> dict[int, str]:
    """Return what must be reported, by line."""
    lines = enumerate(text.splitlines(), start=1)
    return {number: line.partition("  # ")[2] for number, line in lines if "  # " in line}


@pytest.mark.thorough
@pytest.mark.parametrize("text", [PROGRAM, API], ids=["bus", "api"])
def test_pyright_infers_the_same_types_and_finds_the_same_mistakes(tmp_path: Path, text: str):
    program = tmp_path / "program.py"
    program.write_text(text)
    (tmp_path / "pyrightconfig.json").write_text('{"typeCheckingMode": "standard"}')
    done = subprocess.run(
        [sys.executable, "-m", "basedpyright", "--outputjson", "--pythonpath", sys.executable, program],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )  # fmt: skip
    said: dict[int, str] = {}
    for one in json.loads(done.stdout)["generalDiagnostics"]:
        line = one["range"]["start"]["line"] + 1
        revealed = re.fullmatch(r'Type of ".*" is "(.*)"', one["message"], re.DOTALL)
        assert revealed or one["severity"] == "error", one
        said[line] = revealed[1] if revealed else "error"
    wanted = {
        # Pyright names a class without its module, and has codes of its own.
        line: "error"
        if what.startswith("[")
        else re.sub(r"\b(?:\w+\.)+(?=\w)", "", what).replace("'] | Literal['", "', '")
        for line, what in expected(text).items()
    }
    assert said == wanted, done.stderr
