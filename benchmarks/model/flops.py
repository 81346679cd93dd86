"""Count of the floating point operations of a step while it runs."""

import math
from typing import Any
from unittest.mock import patch

from quadctl.schemas.params import DynamicsParams
from quadctl.services.dynamics import rigidbody
from quadctl.services.dynamics.rigidbody import body_constants
from quadctl.services.dynamics.rotor import hover_speed


class _Counted(float):
    """Number that counts its operations."""

    count = 0

    def _by(self, value: float) -> "_Counted":
        _Counted.count += 1
        return _Counted(value)

    def __add__(self, other: Any) -> "_Counted":
        return self._by(float(self) + float(other))

    def __sub__(self, other: Any) -> "_Counted":
        return self._by(float(self) - float(other))

    def __rsub__(self, other: Any) -> "_Counted":
        return self._by(float(other) - float(self))

    def __mul__(self, other: Any) -> "_Counted":
        return self._by(float(self) * float(other))

    def __truediv__(self, other: Any) -> "_Counted":
        return self._by(float(self) / float(other))

    def __rtruediv__(self, other: Any) -> "_Counted":
        return self._by(float(other) / float(self))

    def __neg__(self) -> "_Counted":
        return _Counted(-float(self))

    __radd__, __rmul__ = __add__, __mul__


def _root(x: Any) -> Any:
    _Counted.count += 1
    return _Counted(math.sqrt(float(x)))


def step_flops() -> int:
    """Count additions, multiplications, divisions and roots of one step in still air; signs are free."""
    vehicle = DynamicsParams().vehicle
    motors = (_Counted(hover_speed(vehicle)),) * 4
    numbers = (0.0, 0.0, 1000.0, 1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3)
    state = (*map(_Counted, numbers), *motors)
    body = tuple(map(_Counted, body_constants(vehicle)))
    _Counted.count = 0
    with patch.object(rigidbody, "sqrt", _root):
        rigidbody.step(state, motors, (0.0, 0.0, 0.0), body)
    return _Counted.count
