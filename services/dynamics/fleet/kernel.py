"""The model compiled by numba: a generated module, one loop over blocks of vehicles.

A block holds WIDTH vehicles, a row of each number, so that the processor takes several vehicles
at once through what has no branches: the controller, the mixer and the integration step.
Floating point stays strict; fast arithmetic would gain nothing and cost the equality to the bit.
"""

import ast

from services.dynamics.controller import STEPS
from services.dynamics.fleet.text import merged
from services.dynamics.pilot import PERIODS_TO_REST

WIDTH = 64
"""Vehicles in a block."""

LAYOUT = {"state": 17, "command": 4, "plan": 31, "mode": 8, "wanted": 15, "kind": 1}
"""Rows of a block; the last two are left by one loop for the next."""

CONSTANTS = {"body": 15, "gains": 18, "mixer": 6, "limits": 8, "weight": 1, "spin_up": 1}
"""A block's constants, in one row."""

STORED = sum(LAYOUT[name] for name in ("state", "command", "plan", "mode"))
ROWS = sum(LAYOUT.values())

_ACTS = ("pilot_act", "rigidbody_step")
_DECIDES = ("pilot_choose", "setpoint_setpoint_of", "pilot_lead_on", "pilot_rest")


def source() -> str:
    """A module whose `advance(blocks, constants, start, steps)` runs integration steps of 1 ms.

    `blocks` is (blocks, ROWS * WIDTH) and changed in place, `constants` (blocks, 49). It is
    compiled at its first call; numba keeps what it compiled beside the module.
    """
    inlined = {function.name for function in merged(_ACTS)}
    parts = ["import numpy as np", "from math import sqrt", "from numba import njit"]
    for function in merged((*_ACTS, *_DECIDES)):
        inline = "forceinline=True" if function.name in inlined else "inline='never'"
        parts += [f"@njit(error_model='numpy', {inline})", ast.unparse(function)]
    return "\n".join([*parts, *_rows(), _KERNEL, ""])


def _rows() -> list[str]:
    """Reading and writing what stands in the rows, each row's place a constant without sign."""
    lines, first = [], 0
    for name, count in LAYOUT.items():
        places = [f"_{name}{i}" for i in range(count)]
        lines += [f"{p} = np.uint64({(first + i) * WIDTH})" for i, p in enumerate(places)]
        values = ", ".join(f"q[{place} + n]" for place in places)
        lines += ["@njit(forceinline=True)", f"def _{name}(q, n):", f"    return ({values},)"]
        lines += ["@njit(forceinline=True)", f"def _put_{name}(q, n, v):"]
        lines += [f"    q[{place} + n] = v[{i}]" for i, place in enumerate(places)]
        first += count
    first = 0
    for name, count in CONSTANTS.items():
        values = ", ".join(f"c[{first + i}]" for i in range(count))
        lines += ["@njit(forceinline=True)", f"def _get_{name}(c):", f"    return ({values},)"]
        first += count
    return lines


_KERNEL = f"""
@njit(forceinline=True)
def _plan_of(v):
    return (v[0:9], v[9:18], v[18:27], v[27], v[28], v[29], v[30])


@njit(forceinline=True)
def _flat(p):
    return (*p[0], *p[1], *p[2], p[3], p[4], p[5], p[6])


@njit(error_model='numpy', inline='never')
def _decide(q, n, limits):
    mode, kind = pilot_choose(_state(q, n), _plan_of(_plan(q, n)), _mode(q, n), limits)
    _put_mode(q, n, mode)
    _put_kind(q, n, (kind,))
    _put_wanted(q, n, setpoint_setpoint_of(_plan_of(_plan(q, n)), limits))


@njit(error_model='numpy', inline='never')
def _lead_on(q, n, limits):
    plan, mode = pilot_lead_on(_plan_of(_plan(q, n)), _mode(q, n), _kind(q, n)[0], limits)
    mode = pilot_rest(_state(q, n), _command(q, n), plan, mode, limits)
    _put_plan(q, n, _flat(plan))
    _put_mode(q, n, mode)


@njit(error_model='numpy', inline='never')
def _act(q, c):
    gains = _get_gains(c)
    mixer = _get_mixer(c)
    weight = _get_weight(c)[0]
    for n in range(np.uint64({WIDTH})):
        m0, m1, m2, m3 = pilot_act(
            _state(q, n), _wanted(q, n), _kind(q, n)[0], weight, gains, mixer)
        live = q[_mode2 + n] < {PERIODS_TO_REST}
        c0, c1, c2, c3 = _command(q, n)
        _put_command(q, n, (
            m0 if live else c0, m1 if live else c1, m2 if live else c2, m3 if live else c3))


@njit(error_model='numpy', inline='never')
def _move(q, c):
    body = _get_body(c)
    for n in range(np.uint64({WIDTH})):
        s = _state(q, n)
        t = rigidbody_step(s, _command(q, n), (0.0, 0.0, 0.0), body)
        live = q[_mode2 + n] < {PERIODS_TO_REST}
        _put_state(q, n, (
            {", ".join(f"t[{i}] if live else s[{i}]" for i in range(LAYOUT["state"]))}))


@njit(error_model='numpy', nogil=True, cache=True)
def advance(blocks, constants, start, steps):
    for b in range(blocks.shape[0]):
        q = blocks[b]
        c = constants[b]
        limits = _get_limits(c)
        for count in range(start, start + steps):
            if count % {STEPS} == 0:
                for n in range(np.uint64({WIDTH})):
                    if q[_mode2 + n] < {PERIODS_TO_REST}:
                        _decide(q, n, limits)
                _act(q, c)
                for n in range(np.uint64({WIDTH})):
                    if q[_mode2 + n] < {PERIODS_TO_REST}:
                        _lead_on(q, n, limits)
            _move(q, c)
"""
