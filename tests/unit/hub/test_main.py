"""The hub's main loop, with a stand-in for the node."""

import logging
from collections.abc import Iterator
from typing import Any

import pytest

from quadctl.schemas.params import HubParams, Params
from quadctl.services.hub.__main__ import run


class Spinning:
    """Node that counts its spins, with or without a check of its links."""

    log = logging.getLogger("hub")
    spun = 0

    def spin(self) -> None:
        self.spun += 1

    def ticks(self, _hz: float) -> Iterator[float]:
        self.spun += 1
        yield 0.0


@pytest.mark.parametrize("plain", [[], ["tcp/127.0.0.1:7447", "udp/127.0.0.1:7448"]])
def test_the_hub_logs_plain_endpoints_and_spins(plain: list[str], caplog: pytest.LogCaptureFixture):
    node: Any = Spinning()
    with caplog.at_level(logging.INFO, "hub"):
        run(node, Params(hub=HubParams(listen=[*plain, "tls/127.0.0.1:7449"])))
    assert node.spun == 1
    # Encrypted endpoints belong to the gate.
    assert caplog.messages == [f"listening on {endpoint} as well" for endpoint in plain]
