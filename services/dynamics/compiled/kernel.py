"""Generated numba kernel over blocks of vehicles.

A block holds WIDTH vehicles, with a row for each number, so that the processor computes several
vehicles at once in branch-free code: the controller, the mixer, the integration step, and the
setpoint except for its rare periods, which are computed one vehicle after another. Floating point
stays strict: fast arithmetic would gain nothing and lose the bit-identical results.
"""

import ast
from collections.abc import Mapping
from functools import reduce

from quadctl.services.dynamics.compiled.branchless import PLAIN, RARE
from quadctl.services.dynamics.compiled.source import merged
from quadctl.services.dynamics.controller import STEPS
from quadctl.services.dynamics.flight_modes import PERIODS_TO_REST, TURNS

COMMANDS = """
@njit(error_model='numpy', cache=True)
def goto(blocks, constants, b, lane, x, y, z):
    q, c, n = blocks[b], constants[b], np.uint64(lane)
    plan, mode = flight_modes__goto(
        _plan_of(_plan(q, n)), _mode(q, n), x, y, z, _get_spin_up(c)[0], _get_limits(c))
    _put_plan(q, n, _flat(plan))
    _put_mode(q, n, mode)

@njit(error_model='numpy', cache=True)
def brake(blocks, constants, b, lane):
    q, c, n = blocks[b], constants[b], np.uint64(lane)
    plan, mode = flight_modes__brake(_plan_of(_plan(q, n)), _mode(q, n), _get_limits(c))
    _put_plan(q, n, _flat(plan))
    _put_mode(q, n, mode)

@njit(error_model='numpy', cache=True)
def room(blocks, constants, b, lane):
    q, n = blocks[b], np.uint64(lane)
    return flight_modes__room(_plan_of(_plan(q, n)), _mode(q, n), _get_limits(constants[b]))
"""

WIDTH = 64
"""Vehicles in a block."""

LAYOUT = {
    "state": 17, "command": 4, "plan": 31, "mode": 8, "air": 9, "wanted": 18, "kind": 1, "rare": 1,
}  # fmt: skip
"""Rows of a block; the last three pass values from one loop to the next."""

CONSTANTS = {
    "body": 18, "gains": 21, "mixer": 6, "limits": 8, "weight": 1, "spin_up": 1, "weather": 6,
}  # fmt: skip
"""A block's constants, in one row."""

MOTION = 6
"""First rows of the state: position and velocity."""

STORED = sum(LAYOUT[name] for name in ("state", "command", "plan", "mode", "air"))
ROWS = sum(LAYOUT.values())

_TOGETHER = (
    "wind__blow", "flight_modes__select_mode", "trajectory__setpoint_of",
    "flight_modes__motor_commands", "branchless__glide", "flight_modes__touches",
    "flight_modes__rest", "rigidbody__step",
)  # fmt: skip
"""Functions without loops, which run side by side for all vehicles of a block."""
_ALONE = tuple(f"flight_modes__{name}" for name in ("next_leg", "goto", "brake", "room"))
"""Functions that run for one vehicle, now and then."""


def span(rows: Mapping[str, int], first: str, last: str = "") -> slice:
    """Return the slice of the rows from one name to another."""
    names = list(rows)
    start, end = names.index(first), names.index(last or first) + 1
    return slice(sum(rows[n] for n in names[:start]), sum(rows[n] for n in names[:end]))


def kernel_source() -> str:
    """Return a module whose `fly(blocks, constants, start, steps, motions)` runs steps of 1 ms.

    `blocks` is (blocks, ROWS * WIDTH) and changed in place, `constants` has a row of CONSTANTS for
    each. For each of `motions` (samples, MOTION, blocks * WIDTH) it runs the steps, and writes
    positions and velocities. `goto` and `brake` command one vehicle, by its block and its lane;
    `room` returns the room for its stop. Each is compiled at its first call; numba caches it beside the module.
    """
    return block_source() + _FLY + COMMANDS


def block_source(*others: str) -> str:
    """Return a module whose `_advance(q, c, start, steps)` runs steps of one block, with its constants.

    It has the other functions of the model, too.
    """
    inlined = {function.name for function in merged(_TOGETHER)}
    parts = [_HEAD]
    for function in merged((*_TOGETHER, *_ALONE, *others)):
        inline = "forceinline=True" if function.name in inlined else "inline='never'"
        parts += [f"@njit(error_model='numpy', {inline})", ast.unparse(function)]
    moves = [_move(weather, steps) for weather in _FLOW for steps in (1, 2)]
    return "\n".join([*parts, *_rows(), *moves, _BLOCK])


def _move(weather: str, steps: int) -> str:
    # Two steps at once are faster than one by one: values between them stay in registers.
    step = f"rigidbody__step({{before}}, _command(q, n), {_FLOW[weather]}, body)"
    moved = reduce(lambda text, _: step.format(before=text), range(steps), "s")
    return _MOVE.format(name=f"_{weather}{steps}", moved=moved)


def _rows() -> list[str]:
    """Return functions to read and write each row, its place an unsigned constant."""
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


_HEAD = """
import llvmlite.binding
import numpy as np
from math import sqrt
from numba import config, njit, types
from numba.extending import intrinsic

# By default LLVM uses half of a 512-bit vector, because the full width may lower the clock for a
# moment; pure vector code is faster at full width. Numba reads this once, before it compiles anything.
_features = llvmlite.binding.get_host_cpu_features()
if config.CPU_FEATURES is None and _features.get("avx512f"):
    config.CPU_FEATURES = _features.flatten() + ",-prefer-256-bit"


# A loop has more values than registers. Each value spilled to the stack is a vector of one cache
# line, and LLVM puts it across two lines unless the stack is aligned to one.
@intrinsic
def _align(_context):
    def generate(context, builder, _signature, _arguments):
        builder.function.attributes.alignstack = 64
        builder.function.attributes.add("nounwind")  # without it, the other is not written
        return context.get_dummy_value()

    return types.void(), generate
"""

_MOVE = f"""
@njit(error_model='numpy', inline='never')
def {{name}}(q, c):
    _align()
    body = _get_body(c)
    for n in range(np.uint64({WIDTH})):
        s = _state(q, n)
        t = {{moved}}
        live = q[_mode2 + n] < {PERIODS_TO_REST}
        _put_state(q, n, (
            {", ".join(f"t[{i}] if live else s[{i}]" for i in range(LAYOUT["state"]))}))
"""
"""Integration steps with no control step between them."""

_FLOW = {"calm": "(0.0, 0.0, 0.0)", "wind": "_air(q, n)[0:3]"}
"""Still air is common, and needs no row."""

_PUT_PLAN = "\n".join(
    f"        q[_plan{i} + n] = after[{i}] if plain else before[{i}]" for i in range(LAYOUT["plan"])
)
"""One by one: numba cannot type a tuple of so many conditional expressions."""

_BLOCK = f"""
@njit(forceinline=True)
def _plan_of(v):
    return (v[0:9], v[9:18], v[18:27], v[27], v[28], v[29], v[30])

@njit(forceinline=True)
def _flat(p):
    return (*p[0], *p[1], *p[2], p[3], p[4], p[5], p[6])

@njit(error_model='numpy', inline='never')
def _decide(q, c):
    _align()
    limits = _get_limits(c)
    for n in range(np.uint64({WIDTH})):
        old = _mode(q, n)
        plan = _plan_of(_plan(q, n))
        mode, kind = flight_modes__select_mode(_state(q, n), plan, old, limits)
        live = old[2] < {PERIODS_TO_REST}
        _put_mode(q, n, ({", ".join(f"mode[{i}] if live else old[{i}]" for i in range(8))}))
        _put_kind(q, n, (kind,))
        _put_wanted(q, n, trajectory__setpoint_of(plan, limits))

@njit(error_model='numpy', inline='never')
def _glide(q, c):
    _align()
    limits = _get_limits(c)
    for n in range(np.uint64({WIDTH})):
        before = _plan(q, n)
        mode = _mode(q, n)
        live = mode[2] < {PERIODS_TO_REST}
        flies = live & (_kind(q, n)[0] == 2.0)
        plan, due = branchless__glide(_plan_of(before), limits)
        leads = (mode[3] == {TURNS}) | (mode[4] > 0.0) | flight_modes__touches(_state(q, n)[2], plan, limits)
        rare = flies & ((due == {RARE}) | leads)
        plain = flies & (due == {PLAIN}) & (leads == False)
        after = _flat(plan)
{_PUT_PLAN}
        rests = live & (rare == False)
        calm = flight_modes__rest(_state(q, n), _command(q, n), _plan_of(_plan(q, n)), mode, limits)[2]
        q[_mode2 + n] = calm if rests else mode[2]
        _put_rare(q, n, (1.0 if rare else 0.0,))

@njit(error_model='numpy', inline='never')
def _lead_on(q, n, spin_up, limits):
    plan, mode = flight_modes__next_leg(
        _state(q, n)[2], _plan_of(_plan(q, n)), _mode(q, n), _kind(q, n)[0], spin_up, limits)
    mode = flight_modes__rest(_state(q, n), _command(q, n), plan, mode, limits)
    _put_plan(q, n, _flat(plan))
    _put_mode(q, n, mode)

@njit(error_model='numpy', inline='never')
def _act(q, c):
    _align()
    gains = _get_gains(c)
    mixer = _get_mixer(c)
    weight = _get_weight(c)[0]
    for n in range(np.uint64({WIDTH})):
        m0, m1, m2, m3 = flight_modes__motor_commands(
            _state(q, n), _wanted(q, n), _kind(q, n)[0], weight, gains, mixer, _air(q, n)[6:9])
        live = q[_mode2 + n] < {PERIODS_TO_REST}
        c0, c1, c2, c3 = _command(q, n)
        _put_command(q, n, (
            m0 if live else c0, m1 if live else c1, m2 if live else c2, m3 if live else c3))

@njit(error_model='numpy', inline='never')
def _blow(q, c):
    _align()
    weather = _get_weather(c)
    for n in range(np.uint64({WIDTH})):
        old = _air(q, n)
        new = wind__blow(old, weather)
        live = q[_mode2 + n] < {PERIODS_TO_REST}
        _put_air(q, n, ({", ".join(f"new[{i}] if live else old[{i}]" for i in range(LAYOUT["air"]))}))

@njit(error_model='numpy', inline='never')
def _advance(q, c, start, steps):
    limits = _get_limits(c)
    spin_up = _get_spin_up(c)[0]
    weather = _get_weather(c)
    windy = (weather[0] != 0.0) | (weather[1] != 0.0) | (weather[2] != 0.0) | (weather[4] > 0.0)
    count = start
    while count < start + steps:
        if count % {STEPS} == 0:
            if weather[4] > 0.0:
                _blow(q, c)
            _decide(q, c)
            _act(q, c)
            _glide(q, c)
            for n in range(np.uint64({WIDTH})):
                if q[_rare0 + n] > 0.0:
                    _lead_on(q, n, spin_up, limits)
        pair = (count % 2 == 0) & (count + 1 < start + steps)
        if windy:
            _wind2(q, c) if pair else _wind1(q, c)
        else:
            _calm2(q, c) if pair else _calm1(q, c)
        count += 2 if pair else 1
"""

_FLY = f"""
@njit(error_model='numpy', nogil=True, cache=True)
def fly(blocks, constants, start, steps, motions):
    for b in range(blocks.shape[0]):
        for count in range(motions.shape[0]):
            _advance(blocks[b], constants[b], start + count * steps, steps)
            for row in range({MOTION}):
                for n in range(np.uint64({WIDTH})):
                    motions[count, row, b * np.uint64({WIDTH}) + n] = blocks[b, row * np.uint64({WIDTH}) + n]
"""
