"""Table of every figure with its unit and its bars."""

from dataclasses import dataclass

from benchmarks.bars import AtLeast, AtLeastTimes, AtMost, AtMostTimes, Bar, KnownMiss

GROUPS = (
    "commands", "calls", "topics", "launches", "footprint", "vehicles", "flights", "lockstep",
    "recorder", "recordings", "console", "bridges", "lab",
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """Figure of a group; `key` is its name in figures.json."""

    group: str
    key: str
    name: str
    unit: str
    bars: tuple[Bar, ...] = ()
    known: KnownMiss | None = None

    @property
    def more_is_better(self) -> bool:
        """Return whether the low tail is the bad one."""
        return any(isinstance(bar, AtLeast | AtLeastTimes) for bar in self.bars)

    @property
    def per_second(self) -> float:
        """Return the factor from seconds to this row's unit."""
        return {"ms": 1e3, "us": 1e6}.get(self.unit, 1.0)


_RAW = (AtMostTimes(1.2, "raw"),)
_CLOSE = (AtMostTimes(1.1, "raw"),)
_COMMAND = (AtMost(65), AtMostTimes(1.6, "raw"))
_QUARTER = (*_COMMAND, AtMostTimes(1 / 4, "ros"))
_IMPORTS = KnownMiss(
    AtMostTimes(1.6, "raw"),
    AtMostTimes(1.9, "raw"),
    "half of the time beyond bare Zenoh is the import of msgspec, which imports typing; the other half"
    " is some forty small modules of our own. A command stays a process, and checks its message.",
)
_EXCHANGES = KnownMiss(
    AtMostTimes(1.4, "raw"),
    AtMostTimes(2.2, "raw"),
    "20 times in each simulated second, safety decides and the vehicle flies 50 ms in Python; a bare round"
    " trip does nothing at either end: 1.3 to 1.6 x, the most where Python is slow and a process wakes up fast.",
)
_FLOOD = KnownMiss(
    AtLeastTimes(0.9, "raw"),
    AtLeastTimes(0.45, "raw"),
    "each message goes from Zenoh's thread to the node's loop, with a check of its type, which stays"
    " free for calls and ticks; by hand the thread of Zenoh decodes it, and does nothing else.",
)
_STEADY = KnownMiss(
    AtMost(0),
    AtMost(5),
    "a thousand messages wait for a node's loop, which are 14 ms at this rate; a longer pause of the"
    " loop loses the oldest. By hand nothing waits: the sender does.",
)
_IN_PYTHON = (
    "20 times a second, each vehicle flies, publishes, is judged and read in Python, some 90 us in all with"
    " cold caches; what a hundred vehicles send each other goes in a few messages."
)
_HUNDRED = KnownMiss(AtMost(16), AtMost(25), _IN_PYTHON)
_THOUSAND_LAUNCHED = KnownMiss(
    AtMost(10),
    AtMost(14),
    "each vehicle has some fifty declarations; for each, Zenoh looks through all vehicles at both ends.",
)
_THOUSAND_CALLED = KnownMiss(
    AtMost(50),
    AtMost(250),
    "the benchmark itself takes part of the two cores that the thousand vehicles fill.",
)
_FOXGLOVE = KnownMiss(
    AtMost(5),
    AtMost(6),
    "each message wakes two threads, whose code and data have left the processor's cache since the one"
    " before. It is 3.8 to 5.4 % on one machine, of two thirds of the speed of another, from minute to"
    " minute: there is no room where its neighbours are busy.",
)
_HUNDRED_LAUNCHED = KnownMiss(
    AtMost(0.8),
    AtMost(1.0),
    "five processes take 1.2 s on two cores: each vehicle has four nodes, which lock their names, declare"
    " their topics and services, and announce themselves; safety then begins a hundred take-offs.",
)

ROWS = (
    Row("commands", "call_command", "`service call`, the whole command", "ms",
        (*_COMMAND, AtMostTimes(1 / 13, "ros")), _IMPORTS),
    Row("commands", "topic_list", "`topic list`", "ms", _QUARTER, _IMPORTS),
    Row("commands", "service_list", "`service list`", "ms", _QUARTER, _IMPORTS),
    Row("commands", "node_list", "`node list`", "ms", _QUARTER, _IMPORTS),
    Row("commands", "topic_echo", "`topic echo -n 1` of a 10 Hz topic", "ms", (AtMost(150),)),
    Row("commands", "type_show", "`type show`", "ms", (AtMost(50),)),
    Row("commands", "param_get", "`param get`", "ms", (AtMost(65),)),
    Row("commands", "topic_pub", "`topic pub`, once", "ms", _COMMAND, _IMPORTS),
    Row("calls", "call", "call, warm, typed, through the hub", "us", _CLOSE),
    Row("calls", "call_persistent", "the same beside ROS with a persistent connection", "us"),
    Row("topics", "topic_100", "topic, one way, 1 to 1, 100 Hz", "us", _RAW),
    Row("topics", "topic_1000", "topic, one way, 1 to 1, 1 kHz", "us", _RAW),
    Row("topics", "topic_fan", "topic, one way, 1 to 8, 1 kHz", "us", _CLOSE),
    Row("topics", "throughput", "throughput, 1 to 1, typed, received, beside msgspec and Zenoh by hand", "/s",
        (AtLeast(100_000), AtLeastTimes(0.9, "raw")), _FLOOD),
    Row("topics", "throughput_lost", "the same: lost, of all sent", "%"),
    Row("topics", "steady_lost", "lost at a fifth of the rate of the hand-written subscriber", "%", (AtMost(0),), _STEADY),
    Row("launches", "launch", "launch until all answer", "s", (AtMost(0.3),)),
    Row("launches", "interrupt", "Ctrl-C until nothing is left", "s", (AtMost(0.5),)),
    Row("launches", "orphan", "`kill -9` of `up` until no process is left", "s", (AtMost(2),)),
    Row("launches", "leftovers", "processes and files left by many starts and stops, in sum", "", (AtMost(0),)),
    Row("footprint", "node_memory", "memory of a node (PSS), our largest", "MB",
        (AtMost(25),)),
    Row("footprint", "lone_memory", "memory of a node started alone (PSS)", "MB", (AtMost(25),)),
    Row("footprint", "system_memory", "memory of the whole system (PSS)", "MB", (AtMost(100),)),
    Row("footprint", "hover_processor", "processor, whole system in hover, of one core", "%",
        (AtMostTimes(0.75, "raw"),)),
    Row("footprint", "flight_processor", "processor, whole system in flight, of one core", "%",
        (AtMost(5.5),)),
    Row("footprint", "gone", "`kill -9` of a node until it is in no listing", "ms", (AtMost(50),)),
    Row("vehicles", "vehicles_100", "processor, 100 vehicles of one run in flight, 20 poses a second each, of one core", "%", (AtMost(16),), _HUNDRED),
    Row("vehicles", "watched_100", "the same while somebody subscribes to the poses of all", "%"),
    Row("vehicles", "hover_100", "the same in hover", "%", (AtMost(9),)),
    Row("vehicles", "vehicles_300", "the same of 300 vehicles in flight", "%", (AtMost(100),)),
    Row("vehicles", "hover_300", "the same of 300 in hover", "%"),
    Row("vehicles", "vehicles_1000", "the same of 1000, a quarter of them in flight", "%", (AtMost(200),)),
    Row("vehicles", "hover_1000", "the same of 1000 in hover", "%"),
    Row("vehicles", "goto_1000", "a goto to one of these 1000, p99", "ms", (AtMost(50),), _THOUSAND_CALLED),
    Row("vehicles", "separation_1000", "least distance of two of them, in parts of the one that they keep", "", (AtLeast(1),)),
    Row("vehicles", "each_of_1", "the same of a run of one", "%"),
    Row("vehicles", "each_of_10", "the same of 10, for each", "%"),
    Row("vehicles", "each_of_100", "the same of 100, for each", "%"),
    Row("vehicles", "each_of_300", "the same of 300, for each", "%"),
    Row("vehicles", "launch_100", "launch of 100 vehicles until all answer", "s", (AtMost(0.8),), _HUNDRED_LAUNCHED),
    Row("vehicles", "launch_1000", "launch of 1000 vehicles until all answer", "s", (AtMost(10),), _THOUSAND_LAUNCHED),
    Row("vehicles", "memory_1000", "memory of these 1000 vehicles (PSS)", "MB", (AtMost(700),)),
    Row("vehicles", "plan_300", "plan of `fleet goto` for 300 vehicles that change places at random", "s", (AtMost(10),)),
    Row("flights", "within_05", "3 m step: within 0.5 m", "s", (AtMost(1.6),)),
    Row("flights", "within_02", "3 m step: within 0.2 m", "s", (AtMost(1.9),)),
    Row("flights", "overshoot", "3 m step: overshoot", "m", (AtMost(0.01),)),
    Row("flights", "hover", "hover error, RMS", "m", (AtMost(0.005),)),
    Row("lockstep", "hover_speed", "lock-step: simulated time in hover", "s/s", (AtLeast(50),)),
    Row("lockstep", "mission_speed", "lock-step: the same of a mission", "s/s", ()),
    Row("lockstep", "hover_second", "lock-step: a simulated second of hover, beside 20 bare round trips", "ms",
        (AtMostTimes(1.4, "raw"),), _EXCHANGES),
    Row("lockstep", "mission_second", "the same of a mission, beside these and the compiled steps", "ms",
        (AtMostTimes(1.4, "raw"),), _EXCHANGES),
    Row("lockstep", "plain_second", "the same of a mission without the extra `fleet`", "ms"),
    Row("recorder", "recorder_processor", "the recorder beside the system in flight, of one core",
        "%", (AtMost(5),)),
    Row("recorder", "recorder_rate", "recorded, typed, none lost", "/s", (AtLeast(10_000),)),
    Row("recordings", "plot_hour", "`plot` of an hour's recording", "s", (AtMost(4),)),
    Row("recordings", "plot_memory", "the same: memory (resident)", "MB", (AtMost(120),)),
    Row("recordings", "check_hour", "`bag check` of it", "s", (AtMost(3),)),
    Row("console", "page", "`console`: a page until it shows the vehicle", "s", (AtMost(2),)),
    Row("console", "page_1000", "the same for one of 1000 vehicles, a quarter of them in flight", "s", (AtMost(2),)),
    Row("console", "console_processor", "`console` with a page at 10 Hz, of one core", "%",
        (AtMost(10),)),
    Row("console", "console_memory", "memory of `console` with a page (PSS)", "MB",
        (AtMost(100),)),
    Row("bridges", "ros2_processor", "`bridge ros2` of a vehicle in flight, poses at 100 Hz, of one core", "%",
        (AtMost(5),)),
    Row("bridges", "ros2_memory", "memory of `bridge ros2` (PSS)", "MB", (AtMost(50),)),
    Row("bridges", "ros2_age", "a pose at a client of ROS 2, later than at a Zenoh subscriber", "ms",
        (AtMost(2),)),
    Row("bridges", "foxglove_processor",
        "`bridge foxglove` with a client of all topics, poses at 100 Hz, of one core", "%", (AtMost(5),),
        _FOXGLOVE),
    Row("bridges", "foxglove_memory", "memory of `bridge foxglove` with that client (PSS)", "MB",
        (AtMost(50),)),
    Row("bridges", "foxglove_age", "a pose at a client of Foxglove, later than at a Zenoh subscriber",
        "ms", (AtMost(2),)),
    Row("bridges", "mavlink_processor",
        "`bridge mavlink` of a vehicle in flight, with a ground station, of one core", "%", (AtMost(5),)),
    Row("bridges", "mavlink_memory", "memory of `bridge mavlink` (PSS)", "MB", (AtMost(50),)),
    Row("bridges", "autopilot_processor",
        "`autopilot` of a vehicle in flight, poses at 50 Hz, of one core", "%", (AtMost(5),)),
    Row("bridges", "autopilot_memory", "memory of `autopilot` (PSS)", "MB", (AtMost(50),)),
    Row("lab", "grade_30", "`lab grade` of 30 hand-ins that hold in every row", "s", (AtMost(120),)),
    Row("lab", "import", "`import quadctl`, beyond bare Python", "ms", (AtMost(5),)),
)  # fmt: skip

BY_KEY = {row.key: row for row in ROWS}
