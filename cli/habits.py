"""Lines that users of ROS, PX4 and other tools type: the same lines of ours, or what to type instead.

A line with one obvious meaning just works. Any other prints the command to type.
"""

from quadctl.cli.declarations import is_number

_SAME = {
    "wtf": "doctor",
    "play": "replay",
    "bag record": "record",
    "bag play": "replay",
    "bag reindex": "bag repair",
    "interface show": "type show",
    "interface list": "type list",
    "msg show": "type show",
    "msg list": "type list",
    "srv show": "type show",
    "srv list": "type list",
    "topic type": "topic info",
    "rqt_graph": "graph",
    "service type": "service info",
}
"""Our command by the first words of a line."""

_IDLE = {"record": {"-a", "--all"}, "topic list": {"-v", "--verbose"}, "replay": {"--clock"}}
"""Options that ask for what a command of ours does in any case."""

_GOTO = "`quadctl goto X Y Z` starts the motors, takes off and flies"
_PLACE = "with X and Y of `quadctl state`"
_PICTURE = (
    "`quadctl console` shows the vehicle; `quadctl record` writes for Foxglove and PlotJuggler"
)
_BUILD = "nothing needs a build: `quadctl up -d` starts the system"
_TREE = "the pose is in one frame, ENU: `quadctl topic echo pose`"
_TYPES = "`quadctl topic list` and `quadctl service list` show the types"

INSTEAD = {
    "arm": _GOTO,
    "disarm": f"`quadctl goto X Y 0` lands, {_PLACE}: the motors idle then",
    "takeoff": _GOTO,
    "land": f"`quadctl goto X Y 0` lands, {_PLACE}; `quadctl fleet land-all` lands all",
    "move": _GOTO,
    "stop": "`quadctl hold` stops the vehicle, `quadctl down` all processes",
    "pause": "`quadctl hold` stops the vehicle",
    "start": "`quadctl up -d`",
    "run": "`quadctl up -d`; your own node is a line of [processes] in quad.toml",
    "launch": "`quadctl up -d`; your own nodes are lines of [processes] in quad.toml",
    "core": "`quadctl hub -d` starts a hub alone, `quadctl up -d` the whole system",
    "master": "`quadctl hub -d` starts a hub alone, `quadctl up -d` the whole system",
    "daemon": "`quadctl status` shows the processes of a run",
    "lifecycle": "`quadctl node restart NAME`, `quadctl node kill NAME`",
    "component": "your own node is a line of [processes] in quad.toml: `quadctl up -d`",
    "kill": "`quadctl down` ends all processes, `quadctl node kill NAME` one",
    "shutdown": "`quadctl down`",
    "exit": "`quadctl down`",
    "restart": "`quadctl node restart NAME`, or --all",
    "log": "`quadctl node logs`",
    "logs": "`quadctl node logs`",
    "echo": "`quadctl topic echo`",
    "hz": "`quadctl topic hz`",
    "pub": "`quadctl topic pub`",
    "call": "`quadctl service call`",
    "set": "`quadctl param set NAME VALUE`",
    "get": "`quadctl param get NAME`",
    "list": "`quadctl topic list`, `quadctl service list`, `quadctl node list`",
    "rqt": _PICTURE,
    "rqt_plot": "`quadctl plot`",
    "rqt_console": "`quadctl node logs -f`",
    "rviz": _PICTURE,
    "gazebo": "`quadctl up -d` simulates the vehicle itself",
    "tf": _TREE,
    "view_frames": _TREE,
    "cd": "`quadctl --help`: the code is one package, there are none to change to",
    "pkg": "`quadctl --version`: the code is one package",
    "dep": "`quadctl doctor` checks what is installed",
    "make": _BUILD,
    "build": _BUILD,
    "create": "`quadctl lab new DIR` writes a folder to begin with",
    "action": f"{_GOTO}, and waits for the arrival",
    "multicast": "nothing uses multicast: `quadctl doctor` checks the bus",
    "security": "`quadctl keys init DIR`, `quadctl keys issue ROLE NAME`",
    "check": "`quadctl doctor` checks a system, `quadctl lab check` your own nodes",
    "test": "`quadctl lab check` checks your own nodes, `quadctl demo` ours",
    "grade": "`quadctl lab grade HAND-IN ...`",
    "mission": "`quadctl fly MISSION`",
    "version": "`quadctl --version`",
    "bag filter": "`quadctl record KEY ...` records only these",
    "bag convert": "`quadctl bag export FILE --csv`",
    "cage set": "`quadctl param set safety.virtual_cage.x=3 safety.virtual_cage.y=3`, and z",
    "cage toggle": "`quadctl cage on`, `quadctl cage off`",
    "topic find": _TYPES,
    "service find": _TYPES,
    "service uri": "`quadctl service info SERVICE`",
    "service args": "`quadctl service info SERVICE` shows the fields",
    "param delete": "a parameter has a default: `quadctl param describe NAME` shows it",
    "node machine": "`quadctl node info NAME`",
    "interface package": "`quadctl type list`",
    "interface proto": "`quadctl type show NAME`",
    "msg md5": "`quadctl topic info TOPIC` shows the hash",
}
"""Hint by the first words of a line."""

OPTIONS = {
    (
        "topic echo",
        "-p",
    ): "`quadctl bag export FILE --csv` writes CSV; --json prints a line a message",
    ("topic echo", "-b"): "`quadctl bag export FILE --csv`",
    (
        "topic echo",
        "--csv",
    ): "`quadctl bag export FILE --csv` writes CSV; --json prints a line a message",
    ("topic echo", "--qos-reliability"): "nothing is to be set: `quadctl topic echo TOPIC`",
    ("replay", "-r"): "`quadctl replay FILE --speed 2`",
    ("replay", "--rate"): "`quadctl replay FILE --speed 2`",
    ("replay", "-s"): "`quadctl replay FILE --from 5`",
    ("replay", "-l"): "`quadctl replay FILE`, again and again",
    ("record", "-O"): "`quadctl record -o FILE.mcap`",
}
"""Hint by command and option."""


def translated(words: list[str]) -> list[str]:
    """Return the line of ours that means the same, or the line itself."""
    for count in (2, 1):
        ours = _SAME.get(" ".join(words[:count]))
        if ours is not None and len(words) >= count:
            words = [*ours.split(), *words[count:]]
    for path, idle in _IDLE.items():
        if words[: len(path.split())] == path.split():
            words = [word for word in words if word not in idle]
    return words


def instead(path: str) -> str:
    """Return the hint for an unknown command, e.g. `cage set`; empty if there is none."""
    return INSTEAD.get(path, "")


def instead_of_option(path: str, name: str) -> str:
    """Return the hint for an unknown option of a command; empty if there is none."""
    return OPTIONS.get((path, name), "")


def instead_of_number(path: str, text: str) -> str:
    """Return the hint for a text that is no number; empty if there is none."""
    if "_" in text and is_number(text):
        return "write it without the _"
    if "," not in text or text.startswith(",") or text.strip("-+.,0123456789"):
        return ""
    numbers = text.replace(",", " ").split()
    if len(numbers) == 2:
        return f"{'.'.join(numbers)}: a number has a point"
    if len(numbers) == 1:
        return f"{numbers[0]}: without a comma"
    return f"`quadctl {path} {' '.join(numbers)}`: without commas"
