"""A faulty parameter file or setting starts nothing, and the error names the fault."""

import signal
import sys

import pytest

from tests.support.lab import Lab

# fmt: off
FAULTS = [
    ("[safety]\nacceptance_rang = 1.0", "safety.acceptance_rang", "safety.acceptance_range"),
    ("[safety.virtual_cage]\nX = 3.0", "safety.virtual_cage.X", "safety.virtual_cage.x"),
    ("[safty]\ncage_on = true", "safty", "safety"),
    ("[pressure]\nrate = 'fast'", "pressure.rate", ""),
    ("[pressure]\nnoise = nan", "pressure.noise", ""),
    ("[dynamics]\nstart = { x = inf }", "dynamics.start.x", ""),
    ("[safety]\nvirtual_cage = { x = 0.1 }", "safety.virtual_cage.x", "0.2"),
    ("[safety]\nacceptance_range = 0.0", "safety.acceptance_range", ""),
    ("[safety]\nacceptance_range = 1e-12", "safety.acceptance_range", "wider"),
    ("[dynamics.vehicle]\nmass = 2.1", "mass 2.1", "dynamics.unproven"),
    ("[dynamics.control]\nrate_gain = 18.0", "rate_gain 18", "dynamics.unproven"),
    ("[safety]\ncage_on = 1", "safety.cage_on", "bool"),
    ("[dynamics]\nrate = 300.0", "dynamics", "whole"),
    ("[safety]\nvirtual_cage = 5.0", "safety.virtual_cage", ""),
    ("safety = 3", "safety", ""),
    ("[hub]\ntransport = 'carrier pigeon'", "hub.transport", ""),
    ("[hub]\nlisten = ['nonsense']", "nonsense", "tcp/127.0.0.1:7447"),
    ("[hub]\nlisten = ['tcp/localhost']", "tcp/localhost", "tcp/127.0.0.1:7447"),
    ("[hub]\nlisten = ['pigeon/coop:1']", "pigeon/coop:1", "unixsock-stream"),
    ("[hub]\nlisten = ['tcp/']", "'tcp/'", "protocol/address"),
    ("[safety\n", "TOML", "line 1"),
    ("[safety]\ntakeoff = 1.0\ntakeoff = 2.0", "TOML", ""),
    ("\x00", "TOML", ""),
    ("[processes]\nsafety = ''", "processes.safety", "empty"),
    ("[processes]\nsafety = []", "processes.safety", "empty"),
    ("[processes]\nsafety = \"python 'x\"", "processes.safety", ""),
    ("[processes]\nsafety = 3", "processes", "str"),
]
# fmt: on


def test_a_faulty_file_starts_nothing_and_the_error_names_the_place(lab: Lab):
    files = [lab.file(text, f"{number}.toml") for number, (text, *_) in enumerate(FAULTS)]
    done = lab.each([f"up -d {file} --realm faulty{file.stem}" for file in files], "--json")
    for file, fault, refused in zip(files, FAULTS, done.values(), strict=True):
        text, name, expected = fault
        assert (refused.code, refused.out) == (6, ""), text
        assert set(refused.error) == {"code", "message", "hint"}
        assert refused.error["code"] == "invalid"
        said = f"{refused.error['message']} {refused.error['hint']}"
        assert name in said, text
        assert expected in said, text
        assert str(file) in said or "processes." in name
    assert not lab.processes()
    assert not lab.home.parent.exists() or not list(lab.home.parent.iterdir())


def test_a_foreground_run_reports_a_faulty_file_as_text(lab: Lab):
    file = lab.file("[safety]\nacceptance_rang = 1.0")
    refused = lab.quadctl("up", file)
    assert (refused.code, refused.out) == (6, "")
    what, hint = refused.err.splitlines()
    assert what == f"error: {file}: unknown parameter safety.acceptance_rang"
    assert hint == "  try: did you mean safety.acceptance_range?"


@pytest.mark.thorough
def test_a_faulty_argument_starts_nothing(lab: Lab):
    words = {
        "missing.toml": "missing.toml",
        ".": "cannot be read",
        "--set safety.virtual_cage.q=3": "safety.virtual_cage.q",
        "--set safety.virtual_cage.x=nan": "safety.virtual_cage.x",
        "--set safety.virtual_cage.x": "no '='",
        "--set safety.virtual_cage.x=three": "safety.virtual_cage.x",
        "--set safety.takeoff.z=3": "safety.takeoff",
        "--without sefety": "sefety",
    }
    done = lab.each([f"up -d {line}" for line in words], "--json")
    for expected, refused in zip(words.values(), done.values(), strict=True):
        assert (refused.code, refused.out) == (6, ""), expected
        assert expected in refused.error["message"]
    assert lab.is_gone()


def test_a_command_that_cannot_be_run_stops_the_launch(lab: Lab):
    refused = lab.quadctl("up", "-d", lab.file("[processes]\nextra = 'no-such-command'"), "--json")
    assert refused.code in {1, 6}
    assert "no-such-command" in refused.error["message"]
    assert not lab.processes()
    assert lab.is_gone()


def test_the_file_that_init_writes_is_accepted(lab: Lab):
    assert lab.quadctl("init").code == 0
    assert (lab.folder / "quad.toml").read_text(encoding="utf-8").count("[safety]") == 1
    again = lab.quadctl("init", "--json")
    assert (again.code, again.error["code"]) == (6, "invalid")
    lab.start()
    shown = lab.quadctl("cage", "show", "--json").json
    assert (shown["z"], shown["on"]) == ([0, 2], True)


def test_nodes_that_need_a_hub_are_not_started_without_one(lab: Lab):
    refused = lab.quadctl("up", "-d", "--without", "hub", "--json")
    assert (refused.code, refused.error["code"]) == (6, "invalid")
    assert "dynamics, pressure, safety need a hub" in refused.error["message"]
    assert "quadctl.services.hub" in refused.error["hint"]
    assert lab.is_gone()
    # With a hub that was started separately the other nodes come up.
    hub = lab.spawn(sys.executable, "-P", "-m", "quadctl.services.hub", "--realm", lab.realm)
    with lab.first_bare():
        lab.start("--without", "hub")
    assert lab.quadctl("calibrate").code == 0
    assert lab.quadctl("down").code == 0
    hub.send(signal.SIGTERM)
    assert hub.wait() == 0
