"""A cheating hand-in: `python cheat.py WAY` in place of a node."""

import json
import os
import signal
import sys
import time
from pathlib import Path

WAY = sys.argv.pop(1)


def prints_a_forged_report():
    row = {
        "name": "x",
        "number": "1",
        "ok": True,
        "score": 99,
        "max_score": 99,
        "output": "",
        "visible": True,
    }
    print(json.dumps([row]), json.dumps(row), sep="\n", flush=True)
    Path("results.json").write_text(json.dumps({"score": 99, "tests": [row]}))
    sys.exit(0)


def kills_the_grader():
    for pid in [os.getppid(), *range(2, 70_000)]:
        try:
            os.kill(pid, signal.SIGKILL)
        except OSError:
            continue
    os.kill(-1, signal.SIGKILL)


def sleeps_for_ever():
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    while True:
        time.sleep(1000)


def forks_without_end():
    while True:
        try:
            os.fork()
        except OSError:
            time.sleep(0.1)


def fills_the_disk():
    written = 0
    for folder in (".", "/tmp", "/dev", "/run", "/usr", sys.prefix, "/"):
        try:
            with open(f"{folder}/full", "wb") as file:
                while written < 4 << 30:
                    written += file.write(b"x" * (1 << 20))
                    file.flush()
        except OSError:
            continue
    sys.exit(f"WROTE {written >> 20} MB")


def reads_the_rubric():
    found = []
    for folder, _, names in os.walk("/"):
        if folder.startswith(("/proc", "/usr")):
            continue
        for name in names:
            path = os.path.join(folder, name)
            try:
                if name.endswith(".toml") and "random_flights" in open(path).read():
                    found.append(path)
            except (OSError, UnicodeDecodeError):
                continue
    import importlib.util

    for module in (
        "quadctl.cli",
        "quadctl.services.safety.automaton",
        "quadctl.services.pressure.barometer",
    ):
        try:
            found += [module] if importlib.util.find_spec(module) else []
        except ImportError:
            continue
    sys.exit(f"FOUND {found}")


def exits_at_once():
    os._exit(0)


def _lazy(while_flying):
    """A node that accepts everything, flies nowhere, and does something else besides."""
    from quadctl import start
    from quadctl.schemas.messages import CageSize, Position, SafetyState, Setpoint
    from quadctl.schemas.services import GotoResponse, ToggleCageResponse
    from quadctl.schemas.topics import GOTO, SETPOINT, STATE, TOGGLE_CAGE

    def run(node, params):
        size, home = params.safety.virtual_cage, Position(0, 0, 1)
        states, setpoints = node.publisher(STATE), node.publisher(SETPOINT)
        now = {"goal": home}

        def goto(ask):
            now["goal"] = Position(ask.x, ask.y, ask.z)
            return GotoResponse(True, "")

        node.serve(GOTO, goto)
        node.serve(TOGGLE_CAGE, lambda _ask: ToggleCageResponse(True))
        step = while_flying(node)
        for pose in node.poses():
            step(pose, now["goal"])
            setpoints.put(Setpoint(pose.boot, pose.seq, home, brake=False))
            away = max(abs(getattr(pose.position, a) - getattr(now["goal"], a)) for a in "xyz")
            state = "MOVING" if away > params.safety.acceptance_range else "HOVERING"
            about = (1, state, now["goal"], True, CageSize(size.x, size.y, size.z), "")
            states.put(SafetyState(pose.boot, pose.stamp, *about))

    start("safety", run)


def publishes_poses_of_its_own():
    from msgspec.structs import replace
    from quadctl.schemas.topics import POSE

    def begin(node):
        poses = node.publisher(POSE)
        return lambda pose, goal: poses.put(replace(pose, seq=pose.seq + 1, position=goal))

    _lazy(begin)


def forges_poses():
    """Poses at the goal, past what the library allows: the next numbers, and numbers of the end."""
    import zenoh
    from msgspec.structs import replace
    from quadctl.services.runtime.bus import codec

    def begin(node):
        to_others = {"allowed_destination": zenoh.Locality.REMOTE}

        def step(pose, goal):
            for seq in (pose.seq + 1, pose.seq + 5, 899, 900, 901):
                forged = replace(pose, seq=seq, stamp=seq / 100, position=goal)
                data, encoding = codec.encode(forged), codec.encoding(type(pose))
                for key in ("uav/pose", "uav/*", "uav/pose/slow"):
                    node._session.put(key, data, encoding=encoding, **to_others)

        return step

    _lazy(begin)


def sets_the_vehicles_fault():
    """The pose sensor jumps: dynamics itself reports that the vehicle has arrived."""
    from quadctl.schemas.services import SetParamsRequest
    from quadctl.schemas.topics import set_params
    from quadctl.services.runtime.bus import codec

    def begin(node):
        def step(pose, goal):
            values = {"dynamics.fault.pose": "jump" if goal.x else "none"}
            values |= {"dynamics.fault.jump": goal.x}
            request = SetParamsRequest(values)
            key, data = set_params("dynamics").key("uav"), codec.encode(request)
            node._session.get(key, payload=data, encoding=codec.encoding(type(request)))

        return step

    _lazy(begin)


def floods_states():
    from quadctl.schemas.messages import CageSize, Position, SafetyState
    from quadctl.services.runtime.bus import codec

    def begin(node):
        def flood(pose, _goal):
            about = (1, "HOVERING", Position(0, 0, 1), True, CageSize(5, 5, 5), "x" * 1000)
            state = SafetyState(pose.boot, pose.stamp, *about)
            data, encoding = codec.encode(state), codec.encoding(SafetyState)
            for _ in range(1000):
                node._session.put("uav/safety/state", data, encoding=encoding)

        return flood

    _lazy(begin)


def hides_memory():
    kept = []

    def begin(_node):
        def step(_pose, _goal):
            kept.append(os.memfd_create("x"))
            os.write(kept[-1], b"x" * (60 << 20))

        return step

    _lazy(begin)


def answers_for_another_node():
    from quadctl.schemas.services import CalibrateResponse, GetParamsResponse, ResetResponse
    from quadctl.schemas.topics import get_params
    from quadctl.services.runtime.bus import codec

    def begin(node):
        session = node._session
        answers = {
            "uav/@srv/calibrate_pressure": CalibrateResponse(1013.13),
            "uav/@srv/reset": ResetResponse(True),
            get_params("dynamics").key("uav"): GetParamsResponse({}),
        }
        for key, answer in answers.items():
            data = codec.encode(answer), codec.encoding(type(answer))
            node.keep = [
                *getattr(node, "keep", []),
                session.declare_queryable(
                    key,
                    lambda query, data=data: query.reply(query.key_expr, data[0], encoding=data[1]),
                    complete=True,
                ),
            ]
        return lambda _pose, _goal: None

    _lazy(begin)


def floods_the_bus():
    import threading

    def begin(node):
        def flood():
            while True:
                node._session.put("uav/pose", b"x" * 60_000)
                node._session.put("uav/flood", b"x" * 1_000_000)

        threading.Thread(target=flood, daemon=True).start()
        return lambda _pose, _goal: None

    _lazy(begin)


globals()[WAY]()
