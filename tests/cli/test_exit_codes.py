"""Impossible commands on a running system have their exit codes, and change nothing."""

from tests.support.bare import Bare
from tests.support.lab import Lab

FAILS = {
    "goto nan 0 1": 6,
    "goto 1 2": 2,
    "fleet goto line": 6,
    "fleet goto drone=1,2,1": 6,
    "service call calibrate_pressure zero=7": 6,
    "param get safety.acceptance_rang": 6,
    "param get nonsense": 6,
    "goto 9 0 1": 5,
    "service call goto x=9 y=0 z=1": 5,
}


def test_impossible_commands_fail_with_their_exit_codes(shared_lab: Lab, hover: Bare):
    before = hover.state()
    done = shared_lab.each(FAILS, "--json")
    assert {line: ended.code for line, ended in done.items()} == FAILS
    for line, ended in done.items():
        assert set(ended.error) == {"code", "message", "hint"}, line
        assert "Traceback" not in ended.err
        assert ended.out == "" or ended.code == 5, line
    after = hover.state()
    assert after["request"] == before["request"] + list(FAILS.values()).count(5)
    assert after["goal"] == before["goal"]
