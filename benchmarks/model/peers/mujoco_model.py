"""Vehicle in mujoco's format: a free body with four motors that push along its z axis."""

from collections.abc import Mapping
from math import sqrt


def xml(vehicle: Mapping[str, float], integrator: str, *, lag: bool) -> str:
    """Return a model; each motor is controlled by its thrust (N), in our order of rotors."""
    lever, v = vehicle["arm"] / sqrt(2), vehicle
    ratio = v["torque"] / v["thrust"]
    places = ((lever, lever, 1), (-lever, lever, -1), (-lever, -lever, 1), (lever, -lever, -1))
    dynamics = f'dyntype="filterexact" dynprm="{v["lag"]}"' if lag else ""
    sites = "".join(
        f'<site name="s{i}" pos="{x!r} {y!r} 0"/>' for i, (x, y, _) in enumerate(places)
    )
    motors = "".join(
        f'<general site="s{i}" gear="0 0 1 0 0 {sense * ratio!r}" {dynamics}/>'
        for i, (_, _, sense) in enumerate(places)
    )
    inertia = f"{v['inertia_x']} {v['inertia_y']} {v['inertia_z']}"
    return (
        f'<mujoco><option timestep="0.001" integrator="{integrator}"'
        f' gravity="0 0 {-v["gravity"]}"/><worldbody><body pos="0 0 0"><freejoint/>'
        f'<inertial pos="0 0 0" mass="{v["mass"]}" diaginertia="{inertia}"/>{sites}</body>'
        f"</worldbody><actuator>{motors}</actuator></mujoco>"
    )
