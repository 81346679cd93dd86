"""Exit codes of every command while a process of the run is frozen, line by line."""

from typing import NamedTuple

FREEZABLE = ("hub", "dynamics", "pressure", "safety", "up")
"""Processes of a run; `up` is the supervisor."""

TIMEOUT = 0.75
"""Timeout (s), longer than the half second that safety itself waits for a lost vehicle."""
STREAM_TIMEOUT = 1.5
"""Timeout (s), longer than the period of the slowest topic."""

_NODES = {"dynamics": 4, "pressure": 4, "safety": 4}


class Line(NamedTuple):
    """Command line with its exit code, and with those that differ while a process is frozen."""

    words: str
    code: int = 0
    frozen: dict[str, int] = {}  # noqa: RUF012 - read only

    def expected(self, who: str) -> int:
        return self.frozen.get(who, self.code)


LINES = (
    Line("status"),
    Line("ps"),
    Line("goto 0 0 1", 0, {"hub": 4, "safety": 4, "dynamics": 5}),
    Line("goto 0 0 1 --no-wait", 0, {"hub": 4, "safety": 4, "dynamics": 5}),
    Line("hold", 0, {"hub": 4, "safety": 4}),
    Line("reset", 0, {"hub": 4, "dynamics": 4}),
    Line("fly mission.toml", 0, {"hub": 4, **_NODES}),
    Line("state", 0, {"hub": 4, "safety": 4, "dynamics": 4}),
    Line("fleet list", 0, {"hub": 4, "safety": 4, "dynamics": 4}),
    Line("fleet hold", 0, {"hub": 4, "safety": 4}),
    Line("fleet goto 0 0 1", 0, {"hub": 4, "safety": 4, "dynamics": 5}),
    Line("calibrate", 0, {"hub": 4, "pressure": 4}),
    Line("calibrate --unset", 0, {"hub": 4, "pressure": 4}),
    Line("cage off", 0, {"hub": 4, "safety": 4}),
    Line("cage on", 0, {"hub": 4, "safety": 4}),
    Line("cage show", 0, {"hub": 4, "safety": 4}),
    Line("zone list", 0, {"hub": 4, "safety": 4}),
    Line("zone add zone.toml", 0, {"hub": 4, "safety": 4}),
    Line("zone remove tower", 0, {"hub": 4, "safety": 4}),
    Line("topic list", 0, {"hub": 4}),
    Line("graph", 0, {"hub": 4}),
    Line("topic info safety/state", 0, {"hub": 4, "safety": 4}),
    Line("topic info pose", 0, {"hub": 4, "dynamics": 4}),
    # Safety subscribes, so there is something to show.
    Line("topic info pose/slow", 0, {"hub": 4}),
    Line("topic echo pose -n 1", 0, {"hub": 4, "dynamics": 4}),
    Line("topic echo sensors/pressure -n 1", 0, {"hub": 4, "pressure": 4}),
    Line("topic echo input/position -n 1", 0, {"hub": 4, "safety": 4}),
    Line("topic echo nobodys/own -n 1", 3, {"hub": 4}),
    Line("topic hz sensors/pressure -n 3", 0, {"hub": 4, "pressure": 4}),
    Line("topic bw pose -n 3", 0, {"hub": 4, "dynamics": 4}),
    Line("topic delay pose -n 3", 0, {"hub": 4, "dynamics": 4}),
    # A listener may be no node: only a complete lack of listeners can be detected.
    Line("topic pub input/position_request x=0 y=0 z=1", 0, {"hub": 4, "safety": 3}),
    Line("topic pub nobodys/own text --no-wait", 0, {"hub": 4}),
    Line("service list", 0, {"hub": 4}),
    Line("service info goto", 0, {"hub": 4, "safety": 4}),
    Line("service call calibrate_pressure True", 0, {"hub": 4, "pressure": 4}),
    Line("service call hub/get_params names=[]", 0, {"hub": 4}),
    Line("param list", 0, {"hub": 4, **_NODES}),
    Line("param get safety.takeoff", 0, {"hub": 4, "safety": 4}),
    # A frozen node's values are known from the realm's folder, but cannot be changed.
    Line("param describe safety", 0, {"hub": 4}),
    Line("param dump", 0, {"hub": 4}),
    Line("param load lab.toml", 0, {"hub": 4, "pressure": 4}),
    Line("param set pressure.noise 1e-5", 0, {"hub": 4, "pressure": 4}),
    Line("param diff", 0, {"hub": 4}),
    Line("param save saved.toml", 0, {"hub": 4}),
    # The supervisor's record is shown even behind a frozen hub.
    Line("node list"),
    Line("node info pressure", 0, {"hub": 4, "pressure": 4}),
    Line("node ping safety -n 1", 0, {"hub": 4, "safety": 4}),
    Line("node ping --all -n 1", 0, {"hub": 4, **_NODES}),
    Line("node logs -n 1"),
    Line("type list"),
    Line("type show goto"),
    Line("init"),
    Line("fault list"),
    Line("doctor", 0, dict.fromkeys(FREEZABLE, 8)),
    Line("replay flight.mcap", 7, {"hub": 4}),
    Line("up -d", 7),
    Line("hub -d", 7),
)
"""Lines that change nothing, run with TIMEOUT after the hub has lost the frozen process."""

FRESH = {
    "hub": ("goto 0 0 1", "state", "param describe safety", "node info pressure"),
    "dynamics": ("state", "topic echo pose -n 1"),
    "pressure": ("calibrate",),
    "safety": ("hold", "state", "param list"),
    "up": ("goto 0 0 1", "status"),
}
"""The most telling lines, run at once: they end alike before the hub detects the loss."""

STREAMS = (
    Line("state --watch", 130, {"hub": 4, "safety": 4}),
    Line("topic echo pose", 130, {"hub": 4, "dynamics": 4}),
    Line("topic hz pose", 130, {"hub": 4, "dynamics": 4}),
    Line("topic bw pose", 130, {"hub": 4, "dynamics": 4}),
    Line("topic delay sensors/pressure", 130, {"hub": 4, "pressure": 4}),
    Line("topic pub nobodys/own x=1 --as msgpack -r 20 --no-wait", 130, {"hub": 4}),
    Line("node ping safety -n 1000 --interval 0.05", 130, {"hub": 4, "safety": 4}),
    Line("node logs -f", 130),
    # Safety reports the progress of a flight: without it --arrive ends the wait.
    Line("goto 4 0 1 --arrive 60", 0, {"hub": 4, "dynamics": 5, "safety": 130}),
)
"""Lines that run already at the freeze, with STREAM_TIMEOUT; 130 if they run until Ctrl-C."""

ENDINGS = (
    Line("fleet land-all", 0, {"hub": 4, "safety": 4, "dynamics": 4}),
    Line("node kill pressure"),
    Line("node restart pressure", 0, {"hub": 4, "up": 4}),
    Line("down", 0, {"up": 4}),
)
"""Lines that change the run or its flight, in sequence; a successful one may take longer."""

_KEYS = "it reads and writes a fleet's folder, and calls no node"
_FILES = "it reads a file, and calls no node"
ELSEWHERE = {
    "demo": "it runs in its own realm, and calls no node of this one",
    "lab new": "it writes files",
    "lab check": "it runs in its own realm, and calls no node of this one",
    "lab grade": "it runs each hand-in in a realm of its own",
    "lab rubric check": "it runs each mutant in a realm of its own",
    "autopilot": "it runs in the place of a node; tests/mavlink freezes it",
    "bridge foxglove": "it runs until Ctrl-C; tests/bridges freezes it",
    "bridge mavlink": "it runs until Ctrl-C; tests/bridges freezes it",
    "bridge ros2": "it runs until Ctrl-C; tests/bridges freezes it",
    "record": "it waits for any message until Ctrl-C; test_record.py freezes its hub",
    "plot": "it draws a file, or the messages of a given time; test_plot.py freezes it",
    "bag info": _FILES,
    "bag check": _FILES,
    "bag repair": _FILES,
    "bag export": _FILES,
    "keys init": _KEYS,
    "keys issue": _KEYS,
    "keys list": _KEYS,
    "keys revoke": _KEYS,
    "campaign": "it needs no run, and calls no node",
    "fault inject": "it sets a parameter like `param set`, or sends a signal like `node kill`",
    "fault clear": "the same",
    "fuzz": "it sends a given number of payloads; test_fuzz.py freezes a node before it",
    "console": "it runs until Ctrl-C: tests/cli/test_console_page.py",
}
"""Commands without a line, with the reason."""
