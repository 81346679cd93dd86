"""Speed of the step by hand in C++ (reference.cpp), and the peak of one core."""

import ctypes
import subprocess
import sys
import time
from math import tan

import numpy as np
import numpy.typing as npt

from benchmarks.model.environments import ROOT, Missing
from benchmarks.model.peers.timing import COUNTS, Rates, rate, tell
from quadctl.schemas.params import DynamicsParams
from quadctl.services.dynamics.controller import PERIOD
from quadctl.services.dynamics.rigidbody import State, body_constants, step
from quadctl.services.dynamics.rotor import hover_speed, mixer_constants

_SOURCE = ROOT / "benchmarks" / "model" / "reference.cpp"
_COMPILE = ("g++", "-march=native", "-fPIC", "-shared")
_OPTIONS = {"strict": ("-O3", "-ffp-contract=off"), "fast": ("-Ofast",)}
"""Options that keep the bits of the model, and those that give them up for speed."""
_STEPS = 100
_TURNS = 20_000_000
_CHAINS = 12

Doubles = npt.NDArray[np.float64]


class Reference:
    """Compiled library with the default vehicle's numbers."""

    def __init__(self, options: str = "strict") -> None:
        """Compile the library, strict or fast; raise Missing without a compiler."""
        library = ROOT / ".cache" / f"reference_{options}.so"
        library.parent.mkdir(exist_ok=True)
        words = [*_COMPILE, *_OPTIONS[options], str(_SOURCE), "-o", str(library)]
        try:
            subprocess.run(words, check=True)
        except (FileNotFoundError, subprocess.CalledProcessError) as error:
            raise Missing(f"g++: {error}") from error
        self._library = ctypes.CDLL(str(library))
        self._library.multiply_add.restype = ctypes.c_double
        self.lanes: int = self._library.lanes()
        params = DynamicsParams()
        v, c, inertia = params.vehicle, params.control, params.vehicle.inertia
        kf, km, kl, drag, _, _, _, im, g, gx, gy, gz, ix, iy, iz, *rest = body_constants(v)
        self._body = _doubles(kf, km, kl, drag, im, g, gx, gy, gz, ix, iy, iz, *rest)
        lever, yaw, most, per_thrust, *_ = mixer_constants(v, PERIOD)
        self._control = _doubles(
            c.position_gain, c.velocity_gain, c.attitude_gain, c.rate_gain, c.max_speed,
            tan(c.max_tilt), v.mass, inertia.x, inertia.y, inertia.z, most, lever, yaw, per_thrust,
            1.0, 0.5, 1000.5,
        )  # fmt: skip

    def run(self, name: str, states: Doubles, commands: Doubles, steps: int) -> None:
        """Run `dynamics` or `controlled` for `steps` steps on blocks of (rows, lanes)."""
        getattr(self._library, name)(
            *(ctypes.c_void_p(a.ctypes.data) for a in (states, commands)),
            ctypes.c_long(len(states)), ctypes.c_long(steps), self._body, self._control,
        )  # fmt: skip

    def blocks(self, state: State, count: int) -> tuple[Doubles, Doubles]:
        """Return `count` vehicles in this state, with commands that hold their motors' speeds."""
        size = -(-count // self.lanes)
        values = np.array(state)[None, :, None]
        return (
            _aligned(np.broadcast_to(values, (size, 17, self.lanes))),
            _aligned(np.broadcast_to(values[:, 13:], (size, 4, self.lanes))),
        )

    def peak(self) -> float:
        """Return the peak of one core in double precision (GFLOP/s)."""
        self._library.multiply_add(ctypes.c_long(_TURNS // 10))
        best = 0.0
        for _ in range(5):
            began = time.process_time()
            self._library.multiply_add(ctypes.c_long(_TURNS))
            seconds = time.process_time() - began
            best = max(best, 2e-9 * _CHAINS * self.lanes * _TURNS / seconds)
        return best


def hovering() -> State:
    """Return a state high up, hovering, and turning a little."""
    motors = (hover_speed(DynamicsParams().vehicle),) * 4
    return (0.0, 0.0, 1000.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.05, *motors)


def main(options: str) -> None:
    """Measure; the strict one must fly as the model does, to the last bit."""
    reference = Reference(options)
    state = hovering()
    states, commands = reference.blocks(state, 1)
    reference.run("dynamics", states, commands, _STEPS)
    body = body_constants(DynamicsParams().vehicle)
    command = state[13], state[14], state[15], state[16]
    for _ in range(_STEPS):
        state = step(state, command, (0.0, 0.0, 0.0), body)
    if options == "strict" and states[0, :, 0].tolist() != list(state):
        raise AssertionError("the reference in C++ does not fly as the model does")
    rates: Rates = {"dynamics": {}, "control": {}}
    for count in COUNTS:
        states, commands = reference.blocks(hovering(), count)
        for mode, name in (("dynamics", "dynamics"), ("control", "controlled")):

            def run(
                calls: int, name: str = name, on: Doubles = states, by: Doubles = commands
            ) -> None:
                for _ in range(calls):
                    reference.run(name, on, by, _STEPS)

            rates[mode][count] = rate(run, count * _STEPS)
    if options == "strict":
        # With -Ofast the compiler may shorten the chains whose speed this is.
        rates["peak"] = {1: reference.peak()}
    version = subprocess.run(["g++", "-dumpversion"], capture_output=True, text=True, check=True)
    tell(f"g++ {version.stdout.strip()}", 0.0, rates)


def _doubles(*values: float) -> ctypes.Array[ctypes.c_double]:
    return (ctypes.c_double * len(values))(*values)


def _aligned(values: Doubles) -> Doubles:
    """Return a copy aligned for vectors."""
    room = np.empty(values.size + 8)
    first = -room.ctypes.data % 64 // 8
    copy = room[first : first + values.size].reshape(values.shape)
    copy[...] = values
    return copy


if __name__ == "__main__":
    main(sys.argv[1])
