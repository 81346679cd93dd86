"""Slow imports happen only in the commands that need them."""

import subprocess
import sys
from collections.abc import Collection

from quadctl.cli.commands import COMMANDS

HEAVY = {"mcap", "zstandard", "lz4", "matplotlib", "numpy", "yaml"}
READS_RECORDINGS = {"replay", "bag info", "bag check", "bag repair", "bag export"}
LOAD = """
import importlib, sys
for module in sys.argv[2:]:
    importlib.import_module(module)
print(*sorted(set(sys.argv[1].split(",")) & set(sys.modules)))
"""
READ = """
import sys
from quadctl.cli.values import table_of
table_of(sys.argv[1:])
print("yaml" in sys.modules)
"""


def loaded(*modules: str, of: Collection[str] = HEAVY) -> list[str]:
    command = [sys.executable, "-P", "-c", LOAD, ",".join(of), *modules]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_only_commands_on_recordings_import_heavy_packages():
    others = {
        where.partition(":")[0] for path, where in COMMANDS.items() if path not in READS_RECORDINGS
    }
    assert (
        loaded("quadctl.cli.command", *sorted(others), "quadctl.services.runtime.bus.client") == []
    )


def test_down_and_status_import_no_zenoh():
    commands = ("quadctl.cli.command", "quadctl.cli.run.commands", "quadctl.cli.fault.fault")
    assert loaded(*commands, of=("zenoh", "ctypes", "threading")) == []


def test_yaml_is_imported_only_for_yaml_arguments():
    for words in (["x=1", "y.z=a"], ['{"x": [1, null]}'], ["1", "two"], ["{x: 1}"]):
        command = [sys.executable, "-P", "-c", READ, *words]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        assert done.stdout.strip() == str(words == ["{x: 1}"])


def test_a_node_that_records_nothing_imports_no_heavy_package():
    assert (
        loaded(
            "quadctl.services.runtime.entry",
            "quadctl.services.runtime.supervisor.supervisor",
            "quadctl.services.safety.__main__",
        )
        == []
    )
