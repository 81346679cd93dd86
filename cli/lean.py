"""Loads msgspec without what it brings along and no command of ours needs.

Together that takes 20 ms of every command: what it would take from typing_extensions has been in
typing since 3.11; uuid loads platform to ask for the system's name, which os knows; and textwrap
serves docstrings in JSON Schemas.
"""

import gc
import os
import sys
from types import ModuleType
from typing import Any

gc.disable()  # what is imported stays; to look through it again and again takes 10 ms


class _Later(ModuleType):
    """Stands for a module, and loads it when it is first used."""

    def __getattr__(self, name: str) -> Any:
        from importlib import import_module

        return getattr(import_module(self.__name__), name)


def _platform() -> ModuleType:
    stand_in = _Later("platform")
    stand_in.__dict__["system"] = lambda: os.uname().sysname
    return stand_in


_STAND_INS: dict[str, Any] = {"typing_extensions": None, "textwrap": _Later("textwrap")}
"""By name; an import of what has None fails, as if it were not there."""
if sys.platform != "win32":
    _STAND_INS["platform"] = _platform()
_placed = {name: module for name, module in _STAND_INS.items() if name not in sys.modules}
sys.modules.update(_placed)

import msgspec  # noqa: E402, F401 - loaded here so that all later imports find it loaded

for _name in _placed:
    # Who imports it from here on gets it itself.
    del sys.modules[_name]
