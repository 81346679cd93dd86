"""Simulated vehicle: rigid body, rotors, controller and setpoint, stepped together.

World frame ENU, body frame FLU, SI units; quaternions w, x, y, z, body to world. Time is the
count of integration steps, so equal calls give equal bits.
"""

from collections.abc import Callable
from copy import deepcopy
from math import ceil

from msgspec.structs import replace

from quadctl.schemas.params import DynamicsParams
from quadctl.schemas.vehicle import VehicleParams
from quadctl.services.dynamics import flight_modes, trajectory, wind
from quadctl.services.dynamics.controller import PERIOD, control_constants
from quadctl.services.dynamics.flight_modes import Constants, FlightMode, fresh
from quadctl.services.dynamics.rigidbody import STEP, Motors, State, body_constants
from quadctl.services.dynamics.rotor import hover_speed, mixer_constants
from quadctl.services.dynamics.trajectory import Plan, limits_of
from quadctl.services.dynamics.wind import Air, initial_air, weather_of

LAGS_TO_SPIN_UP = 5.0
"""Motor lags to wait at hover command before take-off: then 1.3 % of the weight is missing."""

Vector = tuple[float, float, float]
"""x, y, z."""

Lane = tuple[State, Motors, Plan, FlightMode, Air]
"""All that a vehicle is at one moment: state, motors' command, plan and mode, and its air."""

Fly = Callable[[State, Motors, Plan, FlightMode, Air, Constants, int, int], Lane]
"""`flight_modes.fly`, or what does the same to the bit."""


def constants_of(params: DynamicsParams) -> Constants:
    """What the model needs of the parameters."""
    vehicle = params.vehicle
    return (
        body_constants(_true(params)),
        control_constants(params),
        mixer_constants(vehicle, PERIOD),
        limits_of(params),
        vehicle.mass * vehicle.gravity,
        float(ceil(LAGS_TO_SPIN_UP * vehicle.motor_lag / PERIOD)),
        weather_of(params),
    )


def _true(params: DynamicsParams) -> VehicleParams:
    """The vehicle as it is, where the controller takes it for sound."""
    share = params.fault.motors
    if share == 1:
        return params.vehicle
    return replace(params.vehicle, thrust_coefficient=share * params.vehicle.thrust_coefficient)


def initial(params: DynamicsParams) -> Lane:
    """A vehicle at rest on its start: on the floor with idle motors, in the air hovering."""
    start = (params.start.x, params.start.y, params.start.z)
    stands = start[2] <= 0.0
    speed = 0.0 if stands else hover_speed(params.vehicle)
    command: Motors = (speed, speed, speed, speed)
    still = (0.0, 0.0, 0.0)
    state: State = (*start, *still, 1.0, 0.0, 0.0, 0.0, *still, *command)
    mode = fresh(standing=stands)
    plan = trajectory.resting(*start, limits_of(params))
    return state, command, plan, mode, initial_air(params)


class Vehicle:
    """A quadrotor that flies to where it is told.

    It starts at rest on `params.start`: in the air it hovers, on the floor its motors idle until
    it is told of a goal above it. A goal below the floor is one on the floor: a landing, which
    ends with idle motors. Once it is at rest its state stands still until it is told of something
    new.

    Its body, gains and limits change at a standstill alone, all together: in flight, new ones could
    make the goal one that it can no longer stop at.
    """

    def __init__(self, params: DynamicsParams) -> None:
        """At rest on `params.start`, at time 0."""
        self.steps = 0
        """Integration steps since boot."""
        self.fly: Fly = flight_modes.fly
        """What takes it through the steps: the text itself, or the same compiled."""
        self.in_force = deepcopy(params)
        """The parameters that it flies by."""
        self._wanted: DynamicsParams | None = None
        self._constants = constants_of(params)
        self._state, self._command, self._plan, self._mode, self._air = initial(params)

    def configure(self, params: DynamicsParams) -> None:
        """Take new parameters, all but `start`.

        Wind and faults take effect at once, body, gains and limits at the next standstill. A later
        call replaces what still waits.
        """
        now = self.in_force
        wanted = deepcopy(params)
        self._use(replace(wanted, vehicle=now.vehicle, control=now.control))
        waits = (wanted.vehicle, wanted.control) != (now.vehicle, now.control)
        self._wanted = wanted if waits else None
        self._settle()

    def _use(self, params: DynamicsParams) -> None:
        self.in_force, self._constants = params, constants_of(params)
        self._mode = flight_modes.woken(self._mode)
        self._air = wind.changed(self._air, self._constants[6])

    def _settle(self) -> None:
        """Adopt what waits, if the vehicle stands or its setpoint is at rest."""
        wanted, limits = self._wanted, self._constants[3]
        if wanted is None or not (self.standing or trajectory.at_rest(self._plan, limits)):
            return
        before = hover_speed(self.in_force.vehicle)
        self._use(wanted)
        self._wanted = None
        x, y, z = (axis[3] for axis in self._plan[:3])
        self._plan = trajectory.resting(x, y, z, self._constants[3])
        if not self.standing and before > 0:
            # A body that changes in the air stays at rest: its motors turn as its weight asks.
            self._turn_motors(hover_speed(wanted.vehicle) / before)

    def _turn_motors(self, factor: float) -> None:
        m0, m1, m2, m3 = self.motors
        c0, c1, c2, c3 = self._command
        self._state = (*self._state[:13], factor * m0, factor * m1, factor * m2, factor * m3)
        self._command = (factor * c0, factor * c1, factor * c2, factor * c3)

    @property
    def time(self) -> float:
        """Simulated time since boot, s."""
        return self.steps * STEP

    @property
    def state(self) -> State:
        """The 17 numbers of rigidbody.py."""
        return self._state

    @property
    def position(self) -> Vector:
        """Position, m, world."""
        x, y, z = self._state[0:3]
        return x, y, z

    @property
    def velocity(self) -> Vector:
        """Velocity, m/s, world."""
        x, y, z = self._state[3:6]
        return x, y, z

    @property
    def orientation(self) -> tuple[float, float, float, float]:
        """Unit quaternion w, x, y, z, body to world."""
        w, x, y, z = self._state[6:10]
        return w, x, y, z

    @property
    def body_rates(self) -> Vector:
        """Angular velocity, rad/s, body."""
        x, y, z = self._state[10:13]
        return x, y, z

    @property
    def motors(self) -> Motors:
        """Motor speeds, rad/s; the order of the rotors is that of rigidbody.py."""
        m0, m1, m2, m3 = self._state[13:17]
        return m0, m1, m2, m3

    @property
    def wind(self) -> Vector:
        """Velocity of the air, m/s, world."""
        x, y, z, _, _, _ = self._air
        return x, y, z

    @property
    def setpoint(self) -> Vector:
        """Where the controller wants the vehicle now, m, world."""
        return flight_modes.place(self._plan, self._constants[3])

    @property
    def goal(self) -> Vector:
        """Where the setpoint comes to rest, m, world."""
        _, _, _, _, hop, x, y, z = self._mode
        if hop > 0.0:
            return x, y, z
        return self._plan[0][3], self._plan[1][3], self._plan[2][3]

    @property
    def standing(self) -> bool:
        """Whether it stands on the floor with idle motors."""
        return self._mode[0] > 0.0

    def goto(self, x: float, y: float, z: float) -> None:
        """Fly to this point, m, world; with the goal it already has, nothing changes."""
        self._plan, self._mode = flight_modes.goto(
            self._plan, self._mode, x, y, z, self._constants[5], self._constants[3]
        )

    def brake(self) -> None:
        """Come to rest where the setpoint soonest can; while braking, nothing changes."""
        self._plan, self._mode = flight_modes.brake(self._plan, self._mode, self._constants[3])

    def advance(self, steps: int) -> None:
        """Run this many integration steps of 1 ms; every fourth since boot is a control step."""
        self._state, self._command, self._plan, self._mode, self._air = self.fly(
            self._state, self._command, self._plan, self._mode, self._air,
            self._constants, self.steps, steps,
        )  # fmt: skip
        self.steps += steps
        self._settle()
