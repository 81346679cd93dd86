"""A node that gives its own `node` wrong arguments gets an error that names the right ones."""

import json

import pytest

from tests.support.lab import Lab
from tests.support.running import eventually

NODE = """
import json
import numpy as np
import quadctl
from quadctl.schemas.messages import Pose, Position, Waypoint
from quadctl.schemas.services import HoldRequest
from quadctl.schemas.topics import HOLD, POSE, STATE, get_params

WORD = quadctl.Topic("own/word", Waypoint, node="", hz=0, doc="A place.")
WRONG = {
    "a text as a topic": lambda node, out: node.publisher("pose"),
    "a text to listen to": lambda node, out: node.listen("pose", print),
    "a text as a service": lambda node, out: node.serve("hold", print),
    "a service twice": lambda node, out: node.serve(get_params(node.name), print),
    "a text as a client's service": lambda node, out: node.client("hold"),
    "a text as a latched topic": lambda node, out: node.latest("state", 1.0),
    "no handler": lambda node, out: node.serve(HOLD, None),
    "a number as a handler": lambda node, out: node.listen(POSE, 3),
    "a text to end": lambda node, out: node.unlisten("pose"),
    "no rate": lambda node, out: node.ticks(0),
    "a text as a rate": lambda node, out: node.ticks("x"),
    "a text as a message": lambda node, out: out.put("x"),
    "another message": lambda node, out: out.put(Position(1.0, 1.0, 1.0)),
    "a number of NumPy": lambda node, out: out.put(Waypoint(np.float64(1), 1.0, 1.0)),
    "a huge number": lambda node, out: out.put(Waypoint(2**70, 1.0, 1.0)),
}

def run(node, params):
    out = node.publisher(WORD)
    for name, wrong in WRONG.items():
        try:
            wrong(node, out)
        except quadctl.Error as error:
            print(json.dumps([name, error.message, error.hint]), flush=True)
    node.spin()

quadctl.start("mistakes", run)
"""


@pytest.mark.thorough
def test_each_wrong_argument_is_an_error_with_a_hint(lab: Lab):
    (lab.folder / "mine.py").write_text(NODE, encoding="utf-8")
    lab.start(lab.file("[processes]\nmistakes = 'python mine.py'\n"))
    wanted = NODE.count("lambda node, out")
    eventually(
        lambda: lab.log("mistakes").count("\n") >= wanted, describe=lambda: lab.log("mistakes")
    )
    found = [json.loads(line) for line in lab.log("mistakes").splitlines() if line[0] == "["]
    assert len(found) == wanted
    assert all(message and hint for _, message, hint in found), found
    messages = {name: message for name, message, _ in found}
    assert messages["a text as a topic"] == "'pose' is no Topic"
    assert messages["no handler"] == "None is no function"
    assert "Waypoint" in messages["another message"]
    assert "NumPy" in {name: hint for name, _, hint in found}["a number of NumPy"]
