"""`demo`: the evidence of its second checkpoint, with a zone in the way."""

import pytest

from quadctl.cli.demo.demo import TOWER, Lab, automaton
from quadctl.schemas.params import Params
from quadctl.services.runtime.bus.client import Client
from tests.support.lab import PATIENT, Lab as System


@pytest.mark.thorough
def test_the_zone_bars_its_inside_and_the_way_through_it_and_is_flown_around(
    lab: System, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(lab.runtime))
    corners = [list(corner) for corner in TOWER.polygon]
    lab.file(f'[[safety.zones]]\nname = "{TOWER.name}"\npolygon = {corners}\n', "quad.toml")
    lab.start("--set", "dynamics.speed=4", *PATIENT)
    with Client(lab.realm, "uav") as client:
        evidence = list(automaton(Lab(client, Params(), lab.home / "logs" / "safety.log")))
    assert all(item.holds for item in evidence), evidence
    *_, inside, through, there, back = [item.text for item in evidence]
    assert inside == "goto -0.6 0.9 1: inside the zone tower"
    assert through == "goto -3 -2 1.5 --direct: the way crosses the zone tower"
    assert there.endswith("in 2 legs around the zone")
    assert back.startswith("goto 1 2 1: arrived within ")
