"""quadctl: the names for your own programs; each is loaded when it is first used."""

import os

TYPE_CHECKING = False  # type checkers know the name; importing typing takes 15 ms

if not os.path.isdir(__path__[0] + "/services"):  # noqa: PTH112 - pathlib is slow
    # A checkout on a system without symbolic links: the three folders are at its top.
    __path__.append(os.path.dirname(os.path.dirname(__path__[0])))  # noqa: PTH120

__all__ = ["Client", "Node", "Params", "QuadctlError", "Service", "Topic", "start"]

if TYPE_CHECKING:
    from quadctl.schemas.params import Params
    from quadctl.schemas.topics import Service, Topic
    from quadctl.services.runtime.bus.client import Client
    from quadctl.services.runtime.entry import start
    from quadctl.services.runtime.errors import QuadctlError
    from quadctl.services.runtime.node import Node
else:  # hidden from type checkers, which would accept any name as ours
    _MODULES = {
        "Client": "services.runtime.bus.client",
        "Node": "services.runtime.node",
        "Params": "schemas.params",
        "QuadctlError": "services.runtime.errors",
        "Service": "schemas.topics",
        "Topic": "schemas.topics",
        "start": "services.runtime.entry",
    }

    def __getattr__(name: str) -> object:
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module

        found = globals()[name] = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
        return found

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
