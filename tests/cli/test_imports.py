"""What takes long to load is loaded by the commands that need it, and by no other."""

import subprocess
import sys

from cli.table import COMMANDS

HEAVY = {"mcap", "zstandard", "lz4", "matplotlib", "numpy"}
READS_RECORDINGS = {"replay", "bag info", "bag check", "bag repair", "bag export"}
LOAD = """
import importlib, sys
for module in sys.argv[2:]:
    importlib.import_module(module)
print(*sorted(set(sys.argv[1].split(",")) & set(sys.modules)))
"""


def loaded(*modules: str) -> list[str]:
    command = [sys.executable, "-P", "-c", LOAD, ",".join(HEAVY), *modules]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_a_command_that_reads_no_recording_loads_nothing_for_that():
    others = {
        where.partition(":")[0] for path, where in COMMANDS.items() if path not in READS_RECORDINGS
    }
    assert loaded("cli.command", *sorted(others), "services.runtime.bus.client") == []


def test_neither_does_a_node_that_records_nothing():
    assert (
        loaded(
            "services.runtime.entry",
            "services.runtime.supervisor.supervisor",
            "services.safety.__main__",
        )
        == []
    )
