"""quadctl: the names for your own programs; each is loaded when it is first used."""

import os

TYPE_CHECKING = False  # type checkers know the name; importing typing takes 15 ms

if not os.path.isdir(__path__[0] + "/services"):  # noqa: PTH112 - pathlib is slow
    # A checkout on a system without symbolic links: the three folders are at its top.
    __path__.append(os.path.dirname(os.path.dirname(__path__[0])))  # noqa: PTH120

__all__ = [
    "AlreadyServed", "Arrival", "BridgedVehicle", "Calibration", "Client", "Error", "Flight", "Invalid",
    "Node", "NotReady", "Params", "QuadctlError", "Refused", "RequestQueue", "Run", "Service", "TimedOut",
    "Topic", "Unreachable", "Vehicle", "Watch", "connect", "launch", "read", "start",
]  # fmt: skip

if TYPE_CHECKING:
    from quadctl.recordings import read
    from quadctl.schemas.params import Params
    from quadctl.schemas.topics import Service, Topic
    from quadctl.services.bridges.base import BridgedVehicle, RequestQueue
    from quadctl.services.runtime.bus.client import Client
    from quadctl.services.runtime.entry import start
    from quadctl.services.runtime.errors import (
        AlreadyServed,
        Invalid,
        NotReady,
        QuadctlError,
        Refused,
        TimedOut,
        Unreachable,
    )
    from quadctl.services.runtime.node import Node
    from quadctl.system import Run, connect, launch
    from quadctl.vehicle import Arrival, Calibration, Flight, Vehicle, Watch

    Error = QuadctlError
else:  # hidden from type checkers, which would accept any name as ours
    _NAMES = {
        "recordings": ("read",),
        "schemas.params": ("Params",),
        "schemas.topics": ("Service", "Topic"),
        "services.bridges.base": ("BridgedVehicle", "RequestQueue"),
        "services.runtime.bus.client": ("Client",),
        "services.runtime.entry": ("start",),
        "services.runtime.errors": (
            "AlreadyServed", "Invalid", "NotReady", "QuadctlError", "Refused", "TimedOut", "Unreachable",
        ),
        "services.runtime.node": ("Node",),
        "system": ("Run", "connect", "launch"),
        "vehicle": ("Arrival", "Calibration", "Flight", "Vehicle", "Watch"),
    }  # fmt: skip
    """Public names by the module that has them."""

    def __getattr__(name: str) -> object:
        from importlib import import_module

        known = "QuadctlError" if name == "Error" else name
        for module, names in _NAMES.items():
            if known in names:
                found = globals()[name] = getattr(import_module(f"{__name__}.{module}"), known)
                return found
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
