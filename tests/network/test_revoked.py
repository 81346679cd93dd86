"""How long a revoked certificate still gets messages, measured by what it hears."""

import time
from pathlib import Path

import pytest
import zenoh

from quadctl.services.runtime.security.registry import Registry
from tests.network.intruder import session
from tests.processes.lab import Lab
from tests.processes.running import eventually
from tests.proofs import Proofs

AT = "tls/127.0.0.1:7729"
MOST = 2.0
ROUNDS = 20


def last_heard_after_revoked(fleet: Registry, folder: Path) -> float:
    """Seconds from `revoke` until the last message came."""
    fleet.issue("operator", {"rob": ["*"]}, 1, [])
    came: list[float] = []

    def hears() -> bool:
        # Until the gate has the new list, it knows nobody of that name, and while it opens anew
        # nobody can connect.
        try:
            opening = session(AT, folder / "rob")
        except zenoh.ZError:
            return False
        with opening as opened:
            opened.declare_subscriber("uav/pose", lambda _: came.append(time.monotonic()))
            try:
                eventually(lambda: len(came) > 5, 1.0)
            except AssertionError:
                return False
            fleet.revoke("rob")
            revoked.append(time.monotonic())
            time.sleep(MOST + 0.5)
            return True

    revoked: list[float] = []
    eventually(hears)
    return max(came) - revoked[0]


@pytest.mark.prove
@pytest.mark.timeout(200)
def test_a_revoked_certificate_gets_nothing_after_two_seconds(lab: Lab, proofs: Proofs):
    assert lab.quadctl("keys", "init").code == 0
    assert lab.quadctl("keys", "issue", "hub").code == 0
    lab.start("--listen", AT, "--identity", "keys/hub")
    keys = lab.folder / "keys"
    took = sorted(last_heard_after_revoked(Registry(keys), keys) for _ in range(ROUNDS))
    proofs.add(
        "a revoked certificate: until its last message",
        f"{took[len(took) // 2] * 1000:.0f} ms, at most {took[-1] * 1000:.0f} ms (n {len(took)})",
        f"{MOST:g} s",
    )
    assert took[-1] < MOST
