"""Types that mypy infers for topics and services, and the errors that it reports."""

import re
import subprocess
import sys
from pathlib import Path

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


def test_mypy_infers_messages_from_topics_and_services(tmp_path: Path):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--no-error-summary", "--no-pretty", str(program)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    said: dict[int, str] = {}
    for line in done.stdout.splitlines():
        found = re.match(
            r'.*program\.py:(\d+): (?:note: Revealed type is "(.*)"|error: .*(\[.*\]))$', line
        )
        assert found, line
        revealed = re.sub(r"\b(?:builtins|quadctl\.schemas\.\w+)\.", "", found[2] or "")
        said[int(found[1])] = revealed or found[3]
    expected = {
        number: line.partition("  # ")[2]
        for number, line in enumerate(PROGRAM.splitlines(), start=1)
        if "  # " in line
    }
    assert said == expected, done.stderr
