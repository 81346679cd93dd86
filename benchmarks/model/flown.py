"""Our flight of a scenario: the model's step alone."""

from benchmarks.model.scenario import COMMAND, RECORD, Flight, start
from quadctl.schemas.vehicle import InertiaParams, RotorDragParams, VehicleParams
from quadctl.services.dynamics.rigidbody import STEP, State, body_constants, step

_NO_LAG = 1e-6
"""Motor lag (s) so short that a motor reaches its command within a step, to the bit."""


def vehicle_of(flight: Flight) -> VehicleParams:
    """Return the scenario's vehicle as parameters."""
    v = flight.vehicle
    return VehicleParams(
        mass=v["mass"],
        inertia=InertiaParams(v["inertia_x"], v["inertia_y"], v["inertia_z"]),
        arm=v["arm"],
        thrust_coefficient=v["thrust"],
        torque_coefficient=v["torque"],
        max_motor_speed=v["most_speed"],
        motor_lag=v["lag"] or _NO_LAG,
        gravity=v["gravity"],
        drag=v["drag"],
        rotor_drag=RotorDragParams(v["across"], v["along"]),
    )


def fly(flight: Flight) -> list[State]:
    """Return the 13 numbers of each state after RECORD s, 2 RECORD s and so on."""
    body = body_constants(vehicle_of(flight))
    motors = (flight.hover,) * 4
    state: State = (*start(flight), *motors)
    states = []
    for number in range(round(flight.seconds / COMMAND)):
        command = flight.command(number)
        if not flight.vehicle["lag"]:
            state = (*state[:13], *command)
        for _ in range(round(COMMAND / STEP)):
            state = step(state, command, flight.wind, body)
        if (number + 1) % round(RECORD / COMMAND) == 0:
            states.append(state[:13])
    return states
