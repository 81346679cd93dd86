"""`quadctl up` on a terminal: a live table of the processes, and a clean terminal afterwards."""

import re
import signal
from collections.abc import Callable, Iterator

import pytest

from tests.support.lab import NODES, Lab
from tests.support.screen import Terminal

Open = Callable[..., Terminal]


@pytest.fixture
def terminal(lab: Lab) -> Iterator[Open]:
    """Function that opens a terminal with `quadctl up` in it."""
    opened = []

    def up(**environment: str) -> Terminal:
        words = lab.command("up", "--set", "safety.takeoff=0")
        opened.append(
            Terminal(words, lab.environment | {"TERM": "xterm"} | environment, lab.folder)
        )
        return opened[-1]

    yield up
    for one in opened:
        one.close()


def row(node: str, state: str, restarts: int) -> Callable[[str], object]:
    return re.compile(rf"^{node} +{state} +\d+ +{restarts}\b", re.MULTILINE).search


@pytest.mark.thorough
def test_the_live_table_is_below_the_lines_and_gone_after_ctrl_c(lab: Lab, terminal: Open):
    up = terminal()
    up.until(lambda seen: "4 of 4 ready" in seen)
    assert up.until(row("safety", "ready", 0)).count("NAME ") == 1
    up.until(re.compile(r"^dynamics +ready +\d+ +0 +[1-9]\d* +\d+ MB +\d+ %$", re.MULTILINE).search)
    assert not up.echoes()
    up.press("\n\n")
    lab.signal("pressure", signal.SIGKILL)
    seen = up.until(row("pressure", "ready", 1))
    assert "pressure ended (SIGKILL): restarting" in seen
    up.resize(30)
    up.until(lambda seen: "RESTARTS" not in seen and "pressure  ready" in seen)
    up.resize(100)
    seen = up.until(lambda seen: "RESTARTS" in seen)
    assert [line.split()[0] for line in seen.splitlines()[-4:]] == NODES
    assert "^C" not in seen
    up.press("\x03")
    assert up.wait() == 130
    assert up.echoes()
    assert "NAME" not in up.screen
    assert "of 4 ready" not in up.screen
    assert up.screen.endswith("\n"), "the shell's prompt begins on a new line"
    assert lab.is_gone()


@pytest.mark.thorough
def test_a_stopped_terminal_stops_no_supervision(lab: Lab, terminal: Open):
    up = terminal()
    up.until(lambda seen: "4 of 4 ready" in seen)
    up.press("\x13")  # Ctrl-S
    lab.revived("pressure", lab.signal("pressure", signal.SIGKILL))
    assert lab.quadctl("down").code == 0
    assert up.wait() == 0
    assert up.echoes()
    assert lab.is_gone()


@pytest.mark.thorough
def test_no_color_and_a_dumb_terminal_are_respected(lab: Lab, terminal: Open):
    up = terminal(NO_COLOR="1")
    up.until(lambda seen: "4 of 4 ready" in seen)
    up.press("\x03")
    assert up.wait() == 130
    assert not re.search(r"\033\[\d*m", up.raw)
    up = terminal(TERM="dumb")
    up.until(lambda seen: "pressure | Param" in seen and "safety   | Param" in seen)
    up.press("\x03")
    assert up.wait() == 130
    assert "\033" not in up.raw


def test_piped_output_has_only_log_lines(lab: Lab):
    run = lab.foreground("--set", "safety.takeoff=0")
    run.send(signal.SIGINT)
    assert run.wait() == 130
    assert all(re.match(r"\d\d:\d\d:\d\d\.\d{3} \w+ +\| ", line) for line in run.log.splitlines())
    assert "\033" not in run.log
