"""The vehicle in Foxglove, flown by Foxglove's own client for Node, @foxglove/ws-protocol."""

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import quadctl
from quadctl.services.runtime.bus.session import free_port
from tests.support.foxglove import TOKEN, bridge


@pytest.fixture(scope="module")
def node_client(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Any]:
    """Return a function that runs Foxglove's own client; it is installed for these tests."""
    assert shutil.which("npm"), "this needs Node with npm: `apt install npm` (Debian, Ubuntu)"
    folder = tmp_path_factory.mktemp("node")
    install = ["npm", "install", "--no-audit", "--no-fund", "@foxglove/ws-protocol@0.8.0", "ws@8"]
    subprocess.run(install, cwd=folder, check=True, timeout=100, capture_output=True)
    script = Path(__file__).with_name("client.mjs")

    def fly(address: str) -> Any:
        done = subprocess.run(
            ["node", script, address], cwd=folder, check=True, timeout=60, stdout=subprocess.PIPE
        )
        return json.loads(done.stdout)

    return fly


@pytest.mark.prove
def test_foxgloves_own_client_flies_the_four_checkpoints(node_client):
    port = free_port()
    with quadctl.launch() as run, bridge(run.realm, port, "--control"):
        found = node_client(f"ws://127.0.0.1:{port}/?token={TOKEN}")
        limit = run.vehicle.params["safety.acceptance_range"]
    outside = found.pop("outside")
    assert 1013 < found.pop("calibrated")["baseline"] < 1014
    assert limit == 0.375
    assert found == {
        "protocol": "foxglove.sdk.v1",
        "cage": {"success": True},
        "inside": {"accepted": True, "reason": ""},
        "read": {"uav.safety.acceptance_range": 0.5},
        "set": {"uav.safety.acceptance_range": 0.375},
        "problems": [],
    }
    assert outside["reason"] == "outside the cage: x = 9 is beyond [-5, 5]"


@pytest.mark.prove
def test_foxgloves_own_client_may_only_watch_without_the_token(node_client):
    port = free_port()
    with quadctl.launch() as run, bridge(run.realm, port, "--control"):
        before = run.vehicle.state()
        found = node_client(f"ws://127.0.0.1:{port}/")
        after = run.vehicle.state()
    for name in ("calibrated", "cage", "inside", "outside"):
        assert found[name]["failure"].startswith("this client may only watch")
    assert found["set"] == found["read"]
    assert all("may only watch" in each for each in found["problems"])
    assert (after.request, after.goal) == (before.request, before.goal)
