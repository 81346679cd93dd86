"""Import of msgspec without the imports of msgspec that no command needs.

They take 25 ms of every command. typing has had the names from typing_extensions since 3.11,
textwrap only formats docstrings in JSON Schemas, the C part of datetime suffices, and no message
has a UUID or a Decimal.
"""

import gc

gc.disable()  # imported objects stay alive; scanning them repeatedly takes 10 ms

import _datetime  # type: ignore[import-not-found]  # noqa: E402
import sys  # noqa: E402
from types import ModuleType  # noqa: E402
from typing import Any  # noqa: E402


class _Later(ModuleType):
    """Stand-in for a module; loads it on first use."""

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
"""Stand-ins by module name; importing a module with None fails as if it were missing."""
_placed = {name: module for name, module in _STAND_INS.items() if name not in sys.modules}
sys.modules.update(_placed)

import msgspec  # noqa: E402, F401 - loaded here so that all later imports find it loaded

for _name in _placed:
    # Later imports get the module itself.
    del sys.modules[_name]
