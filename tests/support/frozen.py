"""How every command ends while a process of the run is frozen, declared line by line."""

from typing import NamedTuple

FREEZABLE = ("hub", "dynamics", "pressure", "safety", "up")
"""Our processes, `up` being the supervisor."""

TIMEOUT = 0.75
"""Seconds; longer than the half second for which safety itself waits for a lost vehicle."""
STREAM_TIMEOUT = 1.5
"""Seconds; longer than the period of the slowest topic."""

_NODES = {"dynamics": 4, "pressure": 4, "safety": 4}


class Line(NamedTuple):
    """A command line: its exit code with nothing frozen, and by who is frozen where it differs."""

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
    Line("topic list", 0, {"hub": 4}),
    Line("topic info safety/state", 0, {"hub": 4, "safety": 4}),
    # Safety listens, so that there is something to tell.
    Line("topic info pose", 0, {"hub": 4}),
    Line("topic echo pose -n 1", 0, {"hub": 4, "dynamics": 4}),
    Line("topic echo sensors/pressure -n 1", 0, {"hub": 4, "pressure": 4}),
    Line("topic echo input/position -n 1", 0, {"hub": 4, "safety": 4}),
    Line("topic echo nobodys/own -n 1", 3, {"hub": 4}),
    Line("topic hz sensors/pressure -n 3", 0, {"hub": 4, "pressure": 4}),
    Line("topic bw pose -n 3", 0, {"hub": 4, "dynamics": 4}),
    Line("topic delay pose -n 3", 0, {"hub": 4, "dynamics": 4}),
    # Who reads a topic is declared nowhere: that nobody listens is all that can be known.
    Line("topic pub input/position_request x=0 y=0 z=1", 0, {"hub": 4, "safety": 3}),
    Line("topic pub nobodys/own text --no-wait", 0, {"hub": 4}),
    Line("service list", 0, {"hub": 4}),
    Line("service info goto", 0, {"hub": 4, "safety": 4}),
    Line("service call calibrate_pressure True", 0, {"hub": 4, "pressure": 4}),
    Line("service call hub/get_params names=[]", 0, {"hub": 4}),
    Line("param list", 0, {"hub": 4, **_NODES}),
    Line("param get safety.takeoff", 0, {"hub": 4, "safety": 4}),
    # A frozen node's values are known from the realm's folder, but it takes no others.
    Line("param describe safety", 0, {"hub": 4}),
    Line("param dump", 0, {"hub": 4}),
    Line("param load lab.toml", 0, {"hub": 4, "pressure": 4}),
    Line("param set pressure.noise 1e-5", 0, {"hub": 4, "pressure": 4}),
    Line("param diff", 0, {"hub": 4}),
    Line("param save saved.toml", 0, {"hub": 4}),
    # What the supervisor knows is shown behind a frozen hub, too.
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
"""What changes nothing, run with TIMEOUT once the hub has lost the frozen one."""

FRESH = {
    "hub": ("goto 0 0 1", "state", "param describe safety", "node info pressure"),
    "dynamics": ("state", "topic echo pose -n 1"),
    "pressure": ("calibrate",),
    "safety": ("hold", "param list"),
    "up": ("goto 0 0 1", "status"),
}
"""The most telling of these, run at once: they end alike before the hub has lost anybody."""

STREAMS = (
    Line("state --watch", 130, {"hub": 4, "safety": 4}),
    Line("topic echo pose", 130, {"hub": 4, "dynamics": 4}),
    Line("topic hz pose", 130, {"hub": 4, "dynamics": 4}),
    Line("topic bw pose", 130, {"hub": 4, "dynamics": 4}),
    Line("topic delay sensors/pressure", 130, {"hub": 4, "pressure": 4}),
    Line("topic pub nobodys/own x=1 --as msgpack -r 20 --no-wait", 130, {"hub": 4}),
    Line("node ping safety -n 1000 --interval 0.05", 130, {"hub": 4, "safety": 4}),
    Line("node logs -f", 130),
    # It is safety that says how far a flight is: without it --arrive ends the wait.
    Line("goto 4 0 1 --arrive 60", 0, {"hub": 4, "dynamics": 5, "safety": 130}),
)
"""Run already when somebody freezes, with STREAM_TIMEOUT; 130 where they go on until Ctrl-C."""

ENDINGS = (
    Line("fleet land-all", 0, {"hub": 4, "safety": 4, "dynamics": 4}),
    Line("node kill pressure"),
    Line("node restart pressure", 0, {"hub": 4, "up": 4}),
    Line("down", 0, {"up": 4}),
)
"""What changes the run or its flight, one after the other; they may take longer where they end well."""

_KEYS = "it reads and writes a fleet's folder, and asks nobody"
_FILES = "it reads a file, and asks nobody"
ELSEWHERE = {
    "demo": "it runs on a realm of its own, and asks nobody of this one",
    "record": "it waits for whatever comes, until Ctrl-C; test_record.py freezes its hub",
    "plot": "it draws a file, or what comes in a time that is asked for; test_plot.py freezes it",
    "bag info": _FILES,
    "bag check": _FILES,
    "bag repair": _FILES,
    "bag export": _FILES,
    "keys init": _KEYS,
    "keys issue": _KEYS,
    "keys list": _KEYS,
    "keys revoke": _KEYS,
    "campaign": "it needs no run, and asks nobody",
    "fault inject": "it sets a parameter as `param set` does, or sends a signal as `node kill`",
    "fault clear": "the same",
    "fuzz": "it throws as much as it is asked to; test_fuzz_command.py freezes a node before it",
    "console": "it goes on until Ctrl-C: tests/cli/test_console_page.py",
}
"""Commands that are in no table, and why."""
