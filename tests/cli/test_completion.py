"""Completion of live names, requested through the environment like a shell does."""

import signal

import pytest

from tests.support.bare import Bare
from tests.support.lab import Lab
from tests.support.running import eventually


def complete(lab: Lab, line: str) -> list[str]:
    done = lab.quadctl(_QUADCTL_COMPLETE="complete_bash", COMP_WORDS=line)
    assert (done.code, done.err) == (0, "")
    return done.out.split()


def wait_for_completion(lab: Lab, line: str, names: list[str]) -> None:
    """Wait for the names: completion never waits, so on a busy machine it may find nothing at first."""
    eventually(lambda: complete(lab, f"quadctl {line}") == names)


@pytest.mark.thorough
def test_live_names_are_completed(shared_lab: Lab, bare: Bare):
    mine = "uav/@node/mine/@pub/Image/00000000/5/uav%camera%left"
    token = bare.session.liveliness().declare_token(mine)
    # `ca` alone does not complete: an unknown relative name is a complete key.
    wait_for_completion(shared_lab, "topic echo uav/ca", ["uav/camera/left"])
    assert complete(shared_lab, "quadctl topic echo ca") == []
    token.undeclare()
    topics = {"pose", "sensors/pressure", "safety/state"}
    eventually(lambda: topics <= set(complete(shared_lab, "quadctl topic echo ")))
    wait_for_completion(shared_lab, "service info tog", ["toggle_cage"])
    wait_for_completion(shared_lab, "node kill /saf", ["/safety"])
    cage = [f"safety.virtual_cage.{axis}" for axis in "xyz"]
    wait_for_completion(shared_lab, "param get safety.virt", cage)
    assert complete(shared_lab, "quadctl --realm nowhere topic echo ") == []


@pytest.mark.thorough
def test_completion_does_not_wait_for_a_frozen_hub_or_node(lab: Lab):
    lab.start("--set", "supervise.answer_timeout=60", "--set", "safety.takeoff=0")
    lab.signal("pressure", signal.SIGSTOP)
    # Completion never waits: on a busy machine safety may miss one request.
    eventually(lambda: "safety.takeoff" in complete(lab, "quadctl param get "))
    names = complete(lab, "quadctl param get ")
    assert not [name for name in names if name.startswith("pressure")]
    lab.signal("hub", signal.SIGSTOP)
    assert complete(lab, "quadctl topic echo ") == []
    for node in ("hub", "pressure"):
        lab.signal(node, signal.SIGCONT)
