"""An import of msgspec without those of its own imports that no command needs.

They take 25 ms of every command. typing has had the names from typing_extensions since 3.11,
textwrap only formats docstrings in JSON Schemas, the C part of datetime suffices, and no message of
ours has a UUID or a Decimal.
"""

import gc

gc.disable()  # what is imported stays; to look through it again and again takes 10 ms

import _datetime  # type: ignore[import-not-found]  # noqa: E402
import sys  # noqa: E402
from types import ModuleType  # noqa: E402
from typing import Any  # noqa: E402


class _Later(ModuleType):
    """Stands for a module, and loads it when it is first used."""

    def __getattr__(self, name: str) -> Any:
        from importlib import import_module

        return getattr(import_module(self.__name__), name)


def _with(name: str, **known: Any) -> ModuleType:
    stand_in = _Later(name)
    stand_in.__dict__.update(known)
    return stand_in


class _Unknown:
    unknown = None


_STAND_INS: dict[str, Any] = {
    "typing_extensions": None,
    "textwrap": _Later("textwrap"),
    "datetime": _datetime,
    "uuid": _with("uuid", UUID=type("UUID", (), {}), SafeUUID=_Unknown),
    "decimal": _with("decimal", Decimal=type("Decimal", (), {})),
}
"""By name; an import of what has None fails, as if it were not there."""
_placed = {name: module for name, module in _STAND_INS.items() if name not in sys.modules}
sys.modules.update(_placed)

import msgspec  # noqa: E402, F401 - loaded here so that all later imports find it loaded

for _name in _placed:
    # Who imports it from here on gets it itself.
    del sys.modules[_name]
