"""`plot`: a picture of a recorded or a live flight."""

import signal

import pytest

from tests.support.bare import Bare
from tests.support.lab import Lab
from tests.support.running import eventually

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.mark.thorough
def test_plot_live_draws_the_current_flight(shared_lab: Lab, hover: Bare):
    done = shared_lab.quadctl("plot", "--live", "--duration", 0.5, "-o", "now.png", "--json")
    assert (done.code, done.err) == (0, "")
    assert done.json["vehicles"] == ["uav"]
    assert done.json["poses"] > 20
    # The seconds of the picture, not of the whole flight so far.
    first = shared_lab.quadctl("topic", "echo", "pose", "-n", 1, "--json").json["stamp"]
    assert 0.2 < done.json["seconds"] < max(first - 1, 5)
    assert (shared_lab.folder / "now.png").read_bytes().startswith(PNG)


@pytest.mark.thorough
def test_ctrl_c_draws_the_poses_received_so_far(shared_lab: Lab, hover: Bare):
    run = shared_lab.spawn(
        *shared_lab.command("plot", "--live", "--duration", 600, "-o", "then.svg")
    )
    eventually(lambda: "listening" in run.log)
    with shared_lab.bare() as bare:
        bare.watch("uav/pose").next(20)
    run.send(signal.SIGINT)
    assert run.wait() == 0, run.log
    assert "drew " in run.log
    assert "<svg" in (shared_lab.folder / "then.svg").read_text()


@pytest.mark.thorough
def test_a_frozen_hub_ends_plot_by_its_timeout(lab: Lab):
    lab.start("--set", "supervise.answer_timeout=60")
    with lab.frozen("hub"):
        done = lab.quadctl("plot", "--live", "--timeout", 0.5, "--json")
    assert (done.code, done.error["code"]) == (4, "timeout")
    assert not (lab.folder / "live.png").exists()
    eventually(lambda: lab.quadctl("state").code == 0)
