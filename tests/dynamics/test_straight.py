"""From a function of numbers to a straight line of numpy calls, with every bit kept."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.dynamics.fleet.scratch import Scratch
from services.dynamics.fleet.straight.emit import Program
from services.dynamics.fleet.straight.operations import Operation, Register
from services.dynamics.fleet.straight.order import ordered
from services.dynamics.fleet.straight.program import program
from services.dynamics.fleet.straight.registers import allocate
from services.dynamics.fleet.straight.symbols import Book, Symbol, traced

A, B, C = (Register("row", number) for number in range(3))
NUMBERS = np.array([[1.5, -0.0, 3.0, math.nan], [2.0, 0.0, -7.0, 1.0], [9.0, 9.0, 9.0, 9.0]])


def ran(made: Program, rows: np.ndarray, times: int = 1) -> np.ndarray:
    rows = rows.copy()
    with np.errstate(all="ignore"):
        Scratch([made], rows.shape[1]).run(made, rows, times)
    return rows


def calls(made: Program) -> list[str]:
    return [line.strip() for line in made.source.splitlines() if line.startswith("        ")]


def same(one: np.ndarray, other: np.ndarray) -> bool:
    """To the bit, the sign of 0 and all."""
    return one.tobytes() == other.tobytes()


def test_results_take_the_places_of_what_they_are_made_of():
    made = program(lambda a, b: (a * a + b, b - a), (A, B), (A, B))
    a, b = NUMBERS[:2]
    assert same(ran(made, NUMBERS)[:2], np.array([a * a + b, b - a]))
    assert same(ran(made, NUMBERS)[2], NUMBERS[2])


def test_inputs_change_places_and_stay_where_they_are_asked_to():
    made = program(lambda a, b, c: (b, a, c), (A, B, C), (A, B, C))
    assert same(ran(made, NUMBERS), NUMBERS[[1, 0, 2]])
    assert same(ran(made, NUMBERS, times=2), NUMBERS)


def test_a_result_may_be_a_float_or_come_twice():
    made = program(lambda a: (-a, -a, 5.0), (A,), (A, B, C))
    a = NUMBERS[0]
    assert same(ran(made, NUMBERS), np.array([-a, -a, np.full(4, 5.0)]))


def test_the_same_is_done_once_and_what_nobody_needs_never():
    def function(a, b):
        _ = a / b
        return (a * b + 1.0) * (a * b + 1.0)

    assert len(calls(program(function, (A, B), A))) == 3


def test_what_all_have_in_common_is_computed_before():
    made = program(lambda a, gain: a * (2.0 * gain), (A, 3.0), A)
    assert len(calls(made)) == 1
    assert same(ran(made, NUMBERS)[0], NUMBERS[0] * 6.0)


def test_a_zero_keeps_its_sign():
    assert len(calls(program(lambda a: -(a - 0.0), (A,), A))) == 1
    for zero in (0.0, -0.0):
        made = program(lambda a, z=zero: (a + z, a - z), (A,), (A, B))
        assert same(ran(made, NUMBERS)[:2], np.array([NUMBERS[0] + zero, NUMBERS[0] - zero]))
    both = program(lambda a: (a * 0.0, a * -0.0), (A,), (A, B))
    assert same(ran(both, NUMBERS)[:2], np.array([NUMBERS[0] * 0.0, NUMBERS[0] * -0.0]))


def test_one_vehicle_alone_goes_too():
    made = program(lambda a, b: a + b, (A, B), A)
    assert ran(made, NUMBERS[:, :1], times=3)[0, 0] == 1.5 + 3 * 2.0


def test_a_choice_that_is_not_the_same_for_all_is_no_python_one():
    with pytest.raises(TypeError, match="not the same for all"):
        program(lambda a: 1.0 if a > 0.0 else 0.0, (A,), A)


def test_places_are_few():
    def chain(*rows):
        total = rows[0]
        for row in rows[1:]:
            total = (total + row) * (total - row)
        return total

    rows = tuple(Register("row", number) for number in range(12))
    assert program(chain, rows, rows[0]).works <= 2


def test_the_order_is_that_of_the_needs():
    one = Operation("input")
    two = Operation("negative", (one,))
    three = Operation("add", (two, one))
    assert ordered([three, two]) == [one, two, three]
    assert [each.target for each in allocate([one, two, three], {one: A}, {three: A})] == [
        Register("work", 0),
        A,
    ]


def test_the_models_text_is_traced():
    body = tuple(1.0 + i for i in range(18))
    book = Book()
    state = tuple(book.input() for _ in range(17))
    after = traced("rigidbody_step")(state, state[13:], (0.0, 0.0, 0.0), body)
    assert len(after) == 17
    assert all(isinstance(number, Symbol) for number in after)


STEPS = st.tuples(
    st.sampled_from(["add", "sub", "mul", "div", "select", "neg", "abs"]),
    *[st.integers(0, 40)] * 4,
)


def recipe(steps: list[tuple[str, int, int, int, int]], ends: list[int]) -> Callable:
    """A function of three numbers, made up; `select` is how it chooses."""

    def function(*given, select):
        numbers = [*given, 0.0, -0.0, 1.5]
        for kind, i, j, k, n in steps:
            x, y, z, w = (numbers[at % len(numbers)] for at in (i, j, k, n))
            made = {
                "add": lambda x=x, y=y: x + y,
                "sub": lambda x=x, y=y: x - y,
                "mul": lambda x=x, y=y: x * y,
                "div": lambda x=x, y=y: x / (y * y + 1.0),
                "select": lambda x=x, y=y, z=z, w=w: select((x < y) & (y >= z), z, w),
                "neg": lambda x=x: -x,
                "abs": lambda x=x: abs(x),
            }[kind]
            numbers.append(made())
        return tuple(numbers[at % len(numbers)] for at in ends)

    return function


@settings(max_examples=300)
@given(
    st.lists(STEPS, max_size=40),
    st.lists(st.integers(0, 46), min_size=3, max_size=3),
    st.integers(1, 3),
)
def test_whatever_is_computed_no_bit_is_lost(
    steps: list[tuple[str, int, int, int, int]], ends: list[int], times: int
):
    function = recipe(steps, ends)

    def on_symbols(*given):
        def select(chosen, one, other):
            if isinstance(chosen, Symbol):
                return chosen.book.write("select", chosen, one, other)
            return one if chosen else other

        return function(*given, select=select)

    made = program(on_symbols, (A, B, C), (A, B, C))
    rows = NUMBERS.copy()
    with np.errstate(all="ignore"):
        for _ in range(times):
            rows = np.array(
                [np.broadcast_to(row, 4) for row in function(*rows, select=np.where)], dtype=float
            )
    assert np.array_equal(ran(made, NUMBERS, times), rows, equal_nan=True)
    assert same(np.signbit(ran(made, NUMBERS, times)), np.signbit(rows)) or np.isnan(rows).any()
