"""Table of all commands and their functions. A new command is a function and a line here."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

from quadctl.cli.context import COMMON
from quadctl.cli.declarations import Option, Parameter, words_of

Command = Callable[..., None]

COMMANDS = {
    "up": "quadctl.cli.run.up:up",
    "hub": "quadctl.cli.run.up:hub",
    "down": "quadctl.cli.run.commands:down",
    "status": "quadctl.cli.run.commands:status",
    "ps": "quadctl.cli.run.commands:status",
    "init": "quadctl.cli.run.commands:init",
    "demo": "quadctl.cli.demo.demo:demo",
    "lab new": "quadctl.cli.lab.lab:new",
    "lab check": "quadctl.cli.lab.lab:check",
    "lab grade": "quadctl.cli.lab.lab:grade",
    "lab rubric check": "quadctl.cli.lab.lab:check_rubric",
    "doctor": "quadctl.cli.doctor.doctor:doctor",
    "graph": "quadctl.cli.graph:graph",
    "console": "quadctl.cli.console.console:console",
    "goto": "quadctl.cli.vehicle.goto:goto",
    "fly": "quadctl.cli.mission.fly:fly",
    "campaign": "quadctl.cli.campaign:campaign",
    "fuzz": "quadctl.cli.fuzz:fuzz",
    "hold": "quadctl.cli.vehicle.commands:hold",
    "reset": "quadctl.cli.vehicle.commands:reset",
    "state": "quadctl.cli.vehicle.state:state",
    "calibrate": "quadctl.cli.vehicle.commands:calibrate",
    "cage on": "quadctl.cli.vehicle.commands:on",
    "cage off": "quadctl.cli.vehicle.commands:off",
    "cage show": "quadctl.cli.vehicle.commands:show",
    "zone list": "quadctl.cli.zone:list_",
    "zone add": "quadctl.cli.zone:add",
    "zone remove": "quadctl.cli.zone:remove",
    "fleet list": "quadctl.cli.fleet.list:list_",
    "fleet goto": "quadctl.cli.fleet.goto:goto",
    "fleet hold": "quadctl.cli.fleet.land:hold",
    "fleet land-all": "quadctl.cli.fleet.land:land_all",
    "autopilot": "quadctl.cli.autopilot.autopilot:autopilot",
    "bridge foxglove": "quadctl.cli.bridge.foxglove:foxglove",
    "bridge mavlink": "quadctl.cli.bridge.mavlink:mavlink",
    "bridge ros2": "quadctl.cli.bridge.ros2:ros2",
    "record": "quadctl.cli.record.record:record",
    "replay": "quadctl.cli.record.replay:replay",
    "plot": "quadctl.cli.plot.plot:plot",
    "bag info": "quadctl.cli.bag:info",
    "bag check": "quadctl.cli.bag:check",
    "bag repair": "quadctl.cli.bag:repair",
    "bag export": "quadctl.cli.bag:export",
    "fault list": "quadctl.cli.fault.fault:list_",
    "fault inject": "quadctl.cli.fault.fault:inject",
    "fault clear": "quadctl.cli.fault.fault:clear",
    "topic list": "quadctl.cli.topic.info:list_",
    "topic info": "quadctl.cli.topic.info:info",
    "topic echo": "quadctl.cli.topic.echo:echo",
    "topic hz": "quadctl.cli.topic.rates:hz",
    "topic bw": "quadctl.cli.topic.rates:bw",
    "topic delay": "quadctl.cli.topic.rates:delay",
    "topic pub": "quadctl.cli.topic.pub:pub",
    "service list": "quadctl.cli.service.service:list_",
    "service info": "quadctl.cli.service.service:info",
    "service call": "quadctl.cli.service.service:call",
    "param list": "quadctl.cli.param.get:list_",
    "param get": "quadctl.cli.param.get:get",
    "param set": "quadctl.cli.param.set:set_",
    "param describe": "quadctl.cli.param.get:describe",
    "param dump": "quadctl.cli.param.files:dump",
    "param load": "quadctl.cli.param.files:load",
    "param diff": "quadctl.cli.param.files:diff",
    "param save": "quadctl.cli.param.files:save",
    "node list": "quadctl.cli.node.info:list_",
    "node info": "quadctl.cli.node.info:info",
    "node ping": "quadctl.cli.node.ping:ping",
    "node logs": "quadctl.cli.node.logs:logs",
    "node restart": "quadctl.cli.node.control:restart",
    "node kill": "quadctl.cli.node.control:kill",
    "keys init": "quadctl.cli.keys:init",
    "keys issue": "quadctl.cli.keys:issue",
    "keys list": "quadctl.cli.keys:list_",
    "keys revoke": "quadctl.cli.keys:revoke",
    "type list": "quadctl.cli.types:list_",
    "type show": "quadctl.cli.types:show",
}

GROUPS = {
    "lab": "Your own nodes, checked and graded.",
    "lab rubric": "Rubrics, checked before they grade.",
    "cage": "The virtual cage.",
    "zone": "Zones that the vehicle must not enter, or not leave.",
    "fleet": "Several vehicles, on one hub or on several machines.",
    "bridge": "Bridges to other networks.",
    "bag": "Recordings.",
    "fault": "Faults injected on purpose.",
    "topic": "Published topics.",
    "service": "Services that can be called.",
    "param": "Parameters of the running system.",
    "node": "Processes on the bus.",
    "keys": "Certificates, the permissions on a network.",
    "type": "Messages and services, field by field.",
}

ALIASES = {"ps"}
"""Commands that the help leaves out."""


def command(path: str) -> Command:
    """Return the function of a command; import its module and no other command's."""
    module, _, name = COMMANDS[path].partition(":")
    found: Any = getattr(import_module(module), name)
    return found  # type: ignore[no-any-return]


def inside(group: str) -> dict[str, str]:
    """Return the paths of the commands and groups in a group by their last words, commands first."""
    paths = {path.rpartition(" ")[::2]: path for path in (*COMMANDS, *GROUPS)}
    return {name: path for (outer, name), path in paths.items() if outer == group}


def meaning(path: str) -> str:
    """Return the meaning of a command or group in one line."""
    return GROUPS.get(path) or (command(path).__doc__ or "").partition("\n")[0]


def _option(name: str, about: str, type_: type = bool, names: tuple[str, ...] = ()) -> Parameter:
    return Parameter(name, type_, Option(about, names))


COMMON_WORDS = [_option(name, about, type_) for name, (type_, about) in COMMON.items()]
"""Options of every command."""
_HELP = _option("help", "Show this message and exit.", names=("-h", "--help"))
_FIRST = [
    _option("version", "Print the version and exit."),
    *COMMON_WORDS,
    _option("install_completion", "Install completion for the current shell."),
    _option(
        "show_completion",
        "Show completion for the current shell, to copy it or customize the installation.",
    ),
]


def words_at(path: str) -> list[Parameter]:
    """Return the words that a command or group takes, or without a path those before a command."""
    own = words_of(command(path)) if path in COMMANDS else []
    return [*own, *(COMMON_WORDS if path else _FIRST), _HELP]
