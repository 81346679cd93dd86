"""Import of msgspec without the imports of msgspec that no command needs.

They take 35 ms of every command. typing has had the names from typing_extensions since 3.11, and
only names two types of re, whose compile msgspec keeps for patterns. textwrap only formats
docstrings in JSON Schemas, msgspec.inspect only describes types, the C part of datetime suffices, and
no message has an Enum, a UUID or a Decimal.
"""

import gc

gc.disable()  # imported objects stay alive; scanning them repeatedly takes 10 ms

import _datetime  # type: ignore[import-not-found]  # noqa: E402
import sys  # noqa: E402
from types import ModuleType  # noqa: E402

TYPE_CHECKING = False  # typing itself is imported below, with a stand-in
if TYPE_CHECKING:
    from typing import Any


class _Later(ModuleType):
    """Stand-in for a module; loads it on first use."""

    def __getattr__(self, name: str) -> "Any":
        from importlib import import_module

        placed = _place()
        if sys.modules.get(self.__name__) is self:
            del sys.modules[self.__name__]
        try:
            module = import_module(self.__name__)
        finally:
            _remove(placed)
        self.__dict__.update(module.__dict__)
        return getattr(module, name)


def _with(name: str, **known: object) -> ModuleType:
    stand_in = _Later(name)
    stand_in.__dict__.update(known)
    return stand_in


class _Unknown:
    unknown = None


def _compile(pattern: str, flags: int = 0) -> "Any":
    import re

    return re.compile(pattern, flags)


_STAND_INS: dict[str, ModuleType | None] = {
    "typing_extensions": None,
    "re": _with(
        "re", Pattern=type("Pattern", (), {}), Match=type("Match", (), {}), compile=_compile
    ),
    "enum": _with("enum", Enum=type("Enum", (), {}), EnumMeta=type("EnumMeta", (type,), {})),
    "textwrap": _Later("textwrap"),
    "datetime": _datetime,
    "uuid": _with("uuid", UUID=type("UUID", (), {}), SafeUUID=_Unknown),
    "decimal": _with("decimal", Decimal=type("Decimal", (), {})),
}
"""Stand-ins by module name; importing a module with None fails as if it were missing."""


def _place() -> list[str]:
    """Put the stand-ins in the places of modules that are not loaded; return their names."""
    placed = [name for name in _STAND_INS if name not in sys.modules]
    sys.modules.update({name: _STAND_INS[name] for name in placed})  # type: ignore[misc]
    return placed


def _remove(placed: list[str]) -> None:
    """Remove stand-ins: later imports get the modules themselves."""
    for name in placed:
        if sys.modules.get(name, _Unknown) is _STAND_INS[name]:
            del sys.modules[name]


_placed = _place()
# This one stays until its first use, and then needs the others.
sys.modules.setdefault("msgspec.inspect", _Later("msgspec.inspect"))

import msgspec  # noqa: E402, F401 - loaded here so that all later imports find it loaded

_remove(_placed)
