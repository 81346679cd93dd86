"""Commands as scripts run them: in the background, in a deleted folder, without a home, on a full disk."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from quadctl.services.runtime.bus.session import free_port
from tests.support.lab import Lab, private_lab
from tests.support.running import Foreground, eventually

IN_BACKGROUND = ("sh", "-c", 'trap "" INT; exec "$@"', "sh")
"""Start of a command line that runs as with a script's `&`: the command inherits SIGINT ignored."""
IN_DELETED = ("sh", "-c", 'mkdir gone && cd gone && rmdir ../gone && exec "$@"', "sh")
ENDLESS = {
    "topic echo pose": 130,
    "topic hz pose": 130,
    "topic bw pose": 130,
    "topic delay pose": 130,
    "topic pub student/word hello -r 5": 130,
    "state --watch": 130,
    "node logs --follow": 130,
    "node ping safety -n 1000000": 130,
    "record flight.mcap": 0,
    "plot --live -d 600 -o flight.png": 0,
    "console --port PORT": 130,
    "bridge foxglove --port PORT": 0,
    "bridge mavlink --to udpout:127.0.0.1:PORT": 0,
    "bridge ros2 --router tcp/127.0.0.1:PORT": 0,
    "hub --realm another": 130,
    "campaign --flights 1000000": 130,
}
"""Commands that run until Ctrl-C, and their exit codes."""
SILENT = {"campaign", "hub"}
"""Those of them that print nothing before."""


@pytest.fixture(scope="module")
def shared() -> Iterator[Lab]:
    with private_lab() as lab:
        lab.start()
        yield lab


HOMES = {
    "of nobody": "/proc/no/home",
    "a file": "/dev/null",
    "with a dangling .bashrc": "dangling",
}


@pytest.fixture
def homeless(lab: Lab, request: pytest.FixtureRequest) -> Lab:
    """Return a lab whose user has this home, and no cache elsewhere."""
    (lab.folder / "dangling").mkdir()
    (lab.folder / "dangling" / ".bashrc").symlink_to("/nowhere/bashrc")
    home = HOMES[request.param]
    lab.environment["HOME"] = str(lab.folder / home) if home == "dangling" else home
    lab.environment["SHELL"] = "/bin/bash"
    del lab.environment["XDG_CACHE_HOME"]
    return lab


@pytest.mark.parametrize("homeless", HOMES, indirect=True)
def test_without_a_home_the_completion_is_refused_in_one_line(homeless: Lab):
    done = homeless.quadctl("--install-completion", "bash")
    assert (done.code, done.out) == (1, "")
    assert "cannot be changed" in done.err
    assert "`quadctl --show-completion` prints the script" in done.err
    assert done.err.count("\n") == 2


@pytest.mark.thorough
@pytest.mark.parametrize("homeless", ["a file"], indirect=True)
def test_without_a_home_all_else_works(homeless: Lab):
    homeless.start()
    for line in ("goto 1 0 1", "plot --live -d 1 -o flight.png", "down"):
        done = homeless.quadctl(*line.split())
        assert (done.code, "Traceback" in done.err) == (0, False), done


@pytest.mark.thorough
def test_in_a_deleted_folder_a_launch_is_refused_and_a_campaign_flies(lab: Lab):
    for line, code in (("up -d", 1), ("demo", 1), ("campaign --flights 2", 0)):
        done = lab.run([*IN_DELETED, *lab.command(*line.split())])
        assert done.code == code, done
        assert "Traceback" not in done.err
        assert ("the current folder was deleted" in done.err) == (code == 1)


@pytest.mark.thorough
def test_on_a_full_disk_nothing_is_left_half_written(shared: Lab):
    """Write files that are larger than `ulimit` allows, as on a full disk."""
    full = ("sh", "-c", 'ulimit -f 2; exec "$@"', "sh")
    recorded = shared.quadctl("record", "-o", "whole.mcap", "-d", "0.5")
    assert recorded.code == 0, recorded
    before = {path.name for path in shared.folder.iterdir()}
    lines = (
        "init new.toml",
        "param dump -o dump.toml",
        "plot whole.mcap -o picture.png",
        "bag export whole.mcap --csv -o tables",
        "lab new mine",
        "campaign --flights 2 --report page.html",
    )
    for line in lines:
        # Python would leave half of a compiled module as well.
        done = shared.run([*full, *shared.command(*line.split())], PYTHONDONTWRITEBYTECODE="1")
        assert done.code == 6, done
        assert "Traceback" not in done.err
        assert "File too large\n  try: make room on its disk" in done.err
    left = {path.name for path in shared.folder.iterdir()} - before
    assert sorted(left) == []


def shows(process: Foreground, line: str) -> bool:
    """Return whether a command has printed something, or may get a Ctrl-C if it prints nothing."""
    if line.partition(" ")[0] in SILENT:
        status = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
        masks = dict(row.split(":\t") for row in status.splitlines())
        number = 1 << (signal.SIGINT - 1)
        return bool(int(masks["SigCgt"], 16) & number and not int(masks["SigBlk"], 16) & number)
    return bool(process.log)


def test_ctrl_c_ends_every_endless_command_of_a_script(shared: Lab):
    commands = {
        line: shared.command(*line.replace("PORT", str(free_port())).split()) for line in ENDLESS
    }
    running = {line: shared.spawn(*IN_BACKGROUND, *words) for line, words in commands.items()}
    eventually(
        lambda: all(shows(process, line) or process.ended for line, process in running.items()),
        describe=lambda: str([line for line, process in running.items() if not process.log]),
    )

    # Before, a Ctrl-C ends the start of a bridge.
    def nodes() -> set[str]:
        return {node["name"] for node in shared.quadctl("node", "list", "--json").json or ()}

    eventually(lambda: nodes() >= {"foxglove", "mavlink", "ros2"})
    for process in running.values():
        process.send(signal.SIGINT)
    ends = {line: process.wait() for line, process in running.items()}
    logs = {line: process.log for line, process in running.items()}
    assert ends == ENDLESS, logs
    assert not [line for line, log in logs.items() if "Traceback" in log], logs
