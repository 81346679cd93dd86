"""Simulated vehicle: rigid body, rotors, controller and setpoint, stepped together.

World frame ENU, body frame FLU, SI units; quaternions w, x, y, z, body to world. Time is the count
of integration steps, so equal calls give equal bits.
"""

from collections.abc import Callable
from copy import deepcopy
from math import ceil

from msgspec.structs import replace

from quadctl.schemas.params import DynamicsParams, by_value
from quadctl.services.airspace.airworthiness import LAGS_TO_SPIN_UP
from quadctl.services.dynamics import flight_modes, trajectory, wind
from quadctl.services.dynamics.controller import PERIOD, control_constants
from quadctl.services.dynamics.flight_modes import (
    PERIODS_TO_REST,
    TURNS,
    Constants,
    FlightMode,
    fresh,
)
from quadctl.services.dynamics.rigidbody import STEP, Motors, State, body_constants
from quadctl.services.dynamics.rotor import hover_speed, mixer_constants
from quadctl.services.dynamics.trajectory import Limits, Plan, limits_of
from quadctl.services.dynamics.wind import Air, initial_air, weather_of

Vector = tuple[float, float, float]

Lane = tuple[State, Motors, Plan, FlightMode, Air]
"""The full state of a vehicle: body state, motors' command, plan, mode and air."""

Fly = Callable[[State, Motors, Plan, FlightMode, Air, Constants, int, int], Lane]
"""`flight_modes.fly`, or its bit-identical compiled form."""


@by_value
def _one(constants: Constants) -> Constants:
    return constants


def constants_of(params: DynamicsParams) -> Constants:
    """Return the constants of the model: one object for vehicles alike, which can fly as one."""
    vehicle = params.vehicle
    # The controller does not know of a motor fault.
    thrust = params.fault.motors * vehicle.thrust_coefficient
    return _one((
        body_constants(replace(vehicle, thrust_coefficient=thrust)),
        control_constants(params),
        mixer_constants(vehicle, PERIOD),
        limits_of(params),
        vehicle.mass * vehicle.gravity,
        float(ceil(LAGS_TO_SPIN_UP * vehicle.motor_lag / PERIOD)),
        weather_of(params),
    ))  # fmt: skip


def initial(params: DynamicsParams) -> Lane:
    """Return a vehicle at rest on its start: on the floor with idle motors, in the air hovering."""
    start = (params.start.x, params.start.y, params.start.z)
    on_floor = start[2] <= 0.0
    speed = 0.0 if on_floor else hover_speed(params.vehicle)
    command: Motors = (speed, speed, speed, speed)
    still = (0.0, 0.0, 0.0)
    state: State = (*start, *still, 1.0, 0.0, 0.0, 0.0, *still, *command)
    mode = fresh(standing=on_floor)
    plan = trajectory.resting(*start, limits_of(params))
    return state, command, plan, mode, initial_air(params)


class Vehicle:
    """Quadrotor that flies to its goal.

    It starts at rest on `params.start`. In the air it hovers; on the floor its motors idle until it
    gets a goal above it. A goal below the floor is one on the floor: a landing, which ends with
    idle motors. At rest its state does not change until the next command.

    Body, gains and limits change only at a standstill, all together: in flight, new ones could make
    the goal one that it can no longer stop at. So do limits that follow from a new wind.
    """

    def __init__(self, params: DynamicsParams) -> None:
        """Put the vehicle at rest on `params.start`, at time 0."""
        self.steps = 0
        """Integration steps since boot."""
        self.fly: Fly = flight_modes.fly
        """Runs the steps: `flight_modes.fly`, or the same compiled."""
        self.in_force = deepcopy(params)
        """The parameters that it flies by."""
        self._wanted: DynamicsParams | None = None
        self.constants = constants_of(params)
        self._state, self._command, self._plan, self._mode, self._air = initial(params)

    def configure(self, params: DynamicsParams) -> None:
        """Take new parameters, all but `start`.

        Wind and faults take effect at once; body, gains and limits at the next standstill. A later
        call replaces values that still wait.
        """
        now, limits = self.in_force, self.constants[3]
        wanted = deepcopy(params)
        self._use(replace(wanted, vehicle=now.vehicle, control=now.control), limits)
        waits = (wanted.vehicle, wanted.control, limits_of(wanted)) != (
            now.vehicle, now.control, limits,
        )  # fmt: skip
        self._wanted = wanted if waits else None
        self._settle()

    def _use(self, params: DynamicsParams, limits: Limits) -> None:
        made = constants_of(params)
        self.in_force, self.constants = params, _one((*made[:3], limits, *made[4:]))
        self._mode = flight_modes.woken(self._mode)
        self._air = wind.changed(self._air, self.constants[6])

    def _settle(self) -> None:
        """Adopt waiting parameters if the vehicle is on the floor or its setpoint at rest."""
        wanted = self._wanted
        if wanted is None or not (self.standing or self.setpoint_rests):
            return
        before = hover_speed(self.in_force.vehicle)
        self._use(wanted, limits_of(wanted))
        self._wanted = None
        x, y, z = (axis[3] for axis in self._plan[:3])
        self._plan = trajectory.resting(x, y, z, self.constants[3])
        if before > 0:
            # A body that changes in the air stays at rest: its motors turn as its weight requires. After
            # a landing they still turn, and must not lift a lighter body, or one with better rotors.
            factor = hover_speed(wanted.vehicle) / before
            m0, m1, m2, m3 = self.motors
            c0, c1, c2, c3 = self._command
            self._state = (*self._state[:13], factor * m0, factor * m1, factor * m2, factor * m3)
            self._command = (factor * c0, factor * c1, factor * c2, factor * c3)

    @property
    def time(self) -> float:
        """Return the simulated time since boot, s."""
        return self.steps * STEP

    @property
    def state(self) -> State:
        """Return the 17 numbers of rigidbody.py."""
        return self._state

    @property
    def position(self) -> Vector:
        """Return the position, m, world."""
        return self._state[0], self._state[1], self._state[2]

    @property
    def velocity(self) -> Vector:
        """Return the velocity, m/s, world."""
        return self._state[3], self._state[4], self._state[5]

    @property
    def orientation(self) -> tuple[float, float, float, float]:
        """Return the unit quaternion w, x, y, z, body to world."""
        return self._state[6], self._state[7], self._state[8], self._state[9]

    @property
    def body_rates(self) -> Vector:
        """Return the angular velocity, rad/s, body."""
        return self._state[10], self._state[11], self._state[12]

    @property
    def motors(self) -> Motors:
        """Return the motor speeds, rad/s, in the order of rigidbody.py."""
        return self._state[13], self._state[14], self._state[15], self._state[16]

    @property
    def wind(self) -> Vector:
        """Return the velocity of the air, m/s, world."""
        return self._air[:3]

    @property
    def setpoint(self) -> Vector:
        """Return the present setpoint's position, m, world."""
        return flight_modes.place(self._plan, self.constants[3])

    @property
    def goal(self) -> Vector:
        """Return the point where the setpoint comes to rest, m, world."""
        _, _, _, braking, hop, x, y, z = self._mode
        if (braking == TURNS) | (hop > 0.0):
            return x, y, z
        return self._plan[0][3], self._plan[1][3], self._plan[2][3]

    @property
    def setpoint_rests(self) -> bool:
        """Return whether the setpoint rests on the goal, wherever the vehicle is."""
        return trajectory.at_rest(self._plan, self.constants[3])

    @property
    def has_waiting(self) -> bool:
        """Return whether parameters wait for its next standstill."""
        return self._wanted is not None

    @property
    def standing(self) -> bool:
        """Return whether it is on the floor with idle motors."""
        return self._mode[0] > 0.0

    @property
    def is_still(self) -> bool:
        """Return whether it stays as it is until its next command: at rest on its setpoint or the floor."""
        return self._mode[2] >= PERIODS_TO_REST

    def stand(self) -> None:
        """Let the motors idle, with the setpoint on the floor below."""
        x, y, _ = self.position
        self._plan = trajectory.resting(x, y, 0.0, self.constants[3])
        self._mode = fresh(standing=True)

    def goto(self, x: float, y: float, z: float) -> None:
        """Fly to this point, m, world; a repeated goal changes nothing."""
        self._plan, self._mode = flight_modes.goto(
            self._plan, self._mode, x, y, z, self.constants[5], self.constants[3]
        )

    def brake(self) -> None:
        """Come to rest as soon as the setpoint can; while braking, change nothing."""
        self._plan, self._mode = flight_modes.brake(self._plan, self._mode, self.constants[3])

    def advance(self, steps: int) -> None:
        """Run this many integration steps of 1 ms; every fourth since boot is a control step."""
        self.take(self.fly(*self.lane, self.constants, self.steps, steps), steps)

    @property
    def lane(self) -> Lane:
        """Return the full state."""
        return self._state, self._command, self._plan, self._mode, self._air

    def take(self, lane: Lane, steps: int) -> None:
        """Take the full state that these steps lead to."""
        self._state, self._command, self._plan, self._mode, self._air = lane
        self.steps += steps
        self._settle()

    def rest(self, steps: int) -> None:
        """Let this many steps pass for a vehicle that is still, as `advance` does."""
        self.steps += steps
