"""The simulated vehicle: rigid body, rotors, controller and setpoint, stepped together.

World frame ENU, body frame FLU, SI units; quaternions w, x, y, z, body to world. Time is the
count of integration steps, so equal calls give equal bits.
"""

from math import ceil, hypot

from schemas.params import DynamicsParams
from services.dynamics.controller import PERIOD, STEPS, control, control_constants
from services.dynamics.rigidbody import STEP, Motors, State, body_constants, step
from services.dynamics.rotor import hover_speed, mix, mixer_constants
from services.dynamics.route import NEAR, leaves, route
from services.dynamics.trajectory import Trajectory, Vector

LAGS_TO_SPIN_UP = 5.0
"""Motor lags to wait at hover command before take-off: then 1.3 % of the weight is missing."""

TOUCHDOWN = 0.01
"""Height under which a vehicle whose setpoint rests on the floor may drop, m."""

REST = 1e-9
"""What a vehicle at rest may be off its setpoint or level, or move: m, rad, m/s and rad/s."""

MOTORS_AT_REST = 1e-6
"""What its motors may be off their command, rad/s."""

PERIODS_TO_REST = 25
"""Control periods that it must have been at rest, 0.1 s: with any force on it, it would not be."""

IDLE: Motors = (0.0, 0.0, 0.0, 0.0)
STILL_AIR: Vector = (0.0, 0.0, 0.0)


class Vehicle:
    """A quadrotor that flies to where it is told.

    It starts at rest on `params.start`: in the air it hovers, on the floor its motors idle until
    it is told of a goal above it. A goal below the floor is one on the floor: a landing, which
    ends with idle motors. Once it is at rest its state stands still until it is told of something
    new: the steps that are left out would only stir the last digits.
    """

    def __init__(self, params: DynamicsParams) -> None:
        """At rest on `params.start`, at time 0."""
        start = (params.start.x, params.start.y, params.start.z)
        self.steps = 0
        """Integration steps since boot."""
        self._trajectory = Trajectory(params, start)
        self._target: Vector | None = None
        self._route: list[Vector] = []
        self._calm = 0
        self._braking = False
        self._standing = start[2] <= 0.0
        self._spin_up = 0
        speed = 0.0 if self._standing else hover_speed(params.vehicle)
        self._command: Motors = (speed, speed, speed, speed)
        still = (0.0, 0.0, 0.0)
        self._state: State = (*start, *still, 1.0, 0.0, 0.0, 0.0, *still, *self._command)
        self.configure(params)

    def configure(self, params: DynamicsParams) -> None:
        """Take new parameters (all but `start`) in flight; the state goes on undisturbed."""
        self._body = body_constants(params.vehicle)
        self._mixer = mixer_constants(params.vehicle, PERIOD)
        self._gains = control_constants(params)
        self._weight = params.vehicle.mass * params.vehicle.gravity
        self._spin_up_periods = ceil(LAGS_TO_SPIN_UP * params.vehicle.motor_lag / PERIOD)
        self._trajectory.configure(params)
        self._calm = 0

    @property
    def time(self) -> float:
        """Simulated time since boot, s."""
        return self.steps * STEP

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
    def setpoint(self) -> Vector:
        """Where the controller wants the vehicle now, m, world."""
        x, y, z = self._trajectory.setpoint[0:3]
        return x, y, z

    @property
    def goal(self) -> Vector:
        """Where the setpoint comes to rest, m, world."""
        return self._route[-1] if self._route else self._trajectory.goal

    @property
    def standing(self) -> bool:
        """Whether it stands on the floor with idle motors."""
        return self._standing

    def goto(self, x: float, y: float, z: float) -> None:
        """Fly to this point, m, world; with the goal it already has, nothing changes."""
        target = (x, y, max(z, 0.0))
        if target == self._target and not self._braking:
            return
        self._target = target
        self._braking = False
        self._calm = 0
        here = self.setpoint
        if self._standing:
            if target[2] <= 0.0 and hypot(target[0] - here[0], target[1] - here[1]) <= NEAR:
                return
            self._standing = False
            self._spin_up = self._spin_up_periods
        self._route = route(here, target)
        self._trajectory.goto(*self._route[0])

    def brake(self) -> None:
        """Come to rest where the setpoint soonest can; while braking, nothing changes."""
        if not self._braking:
            self._braking = True
            self._route = []
            self._calm = 0
            self._trajectory.brake()

    def advance(self, steps: int) -> None:
        """Run this many integration steps of 1 ms; every fourth since boot is a control step."""
        state, command, body = self._state, self._command, self._body
        for count in range(self.steps, self.steps + steps):
            if self._calm >= PERIODS_TO_REST:
                break
            if count % STEPS == 0:
                command = self._control(state)
                self._calm = self._calm + 1 if self._rests(state, command) else 0
            state = step(state, command, STILL_AIR, body)
        self._state, self._command = state, command
        self.steps += steps

    def _control(self, state: State) -> Motors:
        """Motor speed commands for the next period, rad/s."""
        if self._standing:
            return IDLE
        trajectory = self._trajectory
        if self._spin_up > 0:
            self._spin_up -= 1
            return mix(self._weight, 0.0, 0.0, 0.0, state, self._mixer)
        if trajectory.at_rest and trajectory.goal[2] <= 0.0 and state[2] < TOUCHDOWN:
            self._standing = True
            return IDLE
        command = mix(*control(state, trajectory.setpoint, self._gains), state, self._mixer)
        trajectory.advance()
        if leaves(self.setpoint, self._route):
            del self._route[0]
            trajectory.goto(*self._route[0])
        return command

    def _rests(self, state: State, command: Motors) -> bool:
        """Whether it is without motion: standing, or hovering level on its setpoint."""
        trajectory = self._trajectory
        if not (self._standing or trajectory.at_rest):
            return False
        px, py, pz, vx, vy, vz, _, qx, qy, qz, wx, wy, wz, m0, m1, m2, m3 = state
        c0, c1, c2, c3 = command
        x, y, z = trajectory.goal
        place = (0.0,) if self._standing else (px - x, py - y, pz - z, qx, qy, qz)
        return (
            within(REST, vx, vy, vz, wx, wy, wz)
            and within(REST, *place)
            and within(MOTORS_AT_REST, m0 - c0, m1 - c1, m2 - c2, m3 - c3)
        )


def within(limit: float, *numbers: float) -> bool:
    """Whether all of them are nearer to 0 than a limit."""
    return -limit < min(numbers) and max(numbers) < limit
