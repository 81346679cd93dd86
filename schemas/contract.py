"""How a topic and a service are declared: key, types, rate and meaning, written once."""

import math
from typing import Generic, TypeVar

from msgspec import Struct

M = TypeVar("M", bound=Struct)
Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)


def period(stamp: float, hz: float) -> int:
    """Which period of a rate a time (s) falls in.

    The slack takes up the rounding of stamps that meet a boundary.
    """
    return math.floor(stamp * hz + 1e-6)


class Topic(Generic[M]):
    """A key that one process publishes on and any process may listen to.

    `hz` is the declared rate, 0 where messages come only when something happens. A latched
    topic answers `get` on its own key with the last message.
    """

    def __init__(
        self, name: str, type_: type[M], *, node: str, hz: float, doc: str, latched: bool = False
    ) -> None:
        self.name, self.type, self.node = name, type_, node
        self.hz, self.doc, self.latched = hz, doc, latched

    def key(self, vehicle: str) -> str:
        """The Zenoh key, as `uav/sensors/pressure`."""
        return f"{vehicle}/{self.name}"

    def period(self, stamp: float) -> int:
        """Which period of the declared rate a simulated time (s) falls in."""
        return period(stamp, self.hz)


class Service(Generic[Q, R]):
    """A request and its response, on a key that one process answers.

    One that only `reads` changes nothing, and nobody is told of its calls.
    """

    def __init__(
        self,
        name: str,
        request: type[Q],
        response: type[R],
        *,
        node: str,
        doc: str,
        reads: bool = False,
    ) -> None:
        self.name, self.request, self.response = name, request, response
        self.node, self.doc, self.reads = node, doc, reads

    @property
    def type_name(self) -> str:
        """The pair's name, as `Calibrate` for CalibrateRequest and CalibrateResponse."""
        return self.request.__name__.removesuffix("Request")

    def key(self, vehicle: str) -> str:
        """The Zenoh key, as `uav/@srv/goto`; `@srv` is a chunk that wildcards do not match."""
        return f"{vehicle}/@srv/{self.name}"
