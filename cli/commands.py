"""Every command and where it is written: a new one is a function, and a line here."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

Command = Callable[..., None]

COMMANDS = {
    "up": "cli.run.up:up",
    "hub": "cli.run.up:hub",
    "down": "cli.run.commands:down",
    "status": "cli.run.commands:status",
    "ps": "cli.run.commands:status",
    "init": "cli.run.commands:init",
    "demo": "cli.demo.demo:demo",
    "doctor": "cli.doctor.doctor:doctor",
    "console": "cli.console.console:console",
    "goto": "cli.vehicle.goto:goto",
    "fly": "cli.mission.fly:fly",
    "campaign": "cli.campaign:campaign",
    "fuzz": "cli.fuzz:fuzz",
    "hold": "cli.vehicle.commands:hold",
    "reset": "cli.vehicle.commands:reset",
    "state": "cli.vehicle.state:state",
    "calibrate": "cli.vehicle.commands:calibrate",
    "cage on": "cli.vehicle.commands:on",
    "cage off": "cli.vehicle.commands:off",
    "cage show": "cli.vehicle.commands:show",
    "fleet list": "cli.fleet.list:list_",
    "fleet goto": "cli.fleet.goto:goto",
    "fleet hold": "cli.fleet.land:hold",
    "fleet land-all": "cli.fleet.land:land_all",
    "record": "cli.record.record:record",
    "replay": "cli.record.replay:replay",
    "plot": "cli.plot.plot:plot",
    "bag info": "cli.bag:info",
    "bag check": "cli.bag:check",
    "bag repair": "cli.bag:repair",
    "bag export": "cli.bag:export",
    "fault list": "cli.fault.fault:list_",
    "fault inject": "cli.fault.fault:inject",
    "fault clear": "cli.fault.fault:clear",
    "topic list": "cli.topic.info:list_",
    "topic info": "cli.topic.info:info",
    "topic echo": "cli.topic.echo:echo",
    "topic hz": "cli.topic.rates:hz",
    "topic bw": "cli.topic.rates:bw",
    "topic delay": "cli.topic.rates:delay",
    "topic pub": "cli.topic.pub:pub",
    "service list": "cli.service.info:list_",
    "service info": "cli.service.info:info",
    "service call": "cli.service.call:call",
    "param list": "cli.param.get:list_",
    "param get": "cli.param.get:get",
    "param set": "cli.param.set:set_",
    "param describe": "cli.param.get:describe",
    "param dump": "cli.param.files:dump",
    "param load": "cli.param.files:load",
    "param diff": "cli.param.files:diff",
    "param save": "cli.param.files:save",
    "node list": "cli.node.info:list_",
    "node info": "cli.node.info:info",
    "node ping": "cli.node.ping:ping",
    "node logs": "cli.node.logs:logs",
    "node restart": "cli.node.control:restart",
    "node kill": "cli.node.control:kill",
    "keys init": "cli.keys:init",
    "keys issue": "cli.keys:issue",
    "keys list": "cli.keys:list_",
    "keys revoke": "cli.keys:revoke",
    "type list": "cli.types:list_",
    "type show": "cli.types:show",
}

GROUPS = {
    "cage": "The virtual cage.",
    "fleet": "Several vehicles, on one hub or on several machines.",
    "bag": "Recordings.",
    "fault": "What goes wrong, to order.",
    "topic": "What is published.",
    "service": "What can be called.",
    "param": "Parameters of the running system.",
    "node": "The processes on the bus.",
    "keys": "Who may do what on a network: certificates.",
    "type": "Messages and services, field by field.",
}

ALIASES = {"ps"}
"""Commands that help does not list."""


def command(path: str) -> Command:
    """The function of a command; loads the module that it stands in, and no other's."""
    module, _, name = COMMANDS[path].partition(":")
    found: Any = getattr(import_module(module), name)
    return found  # type: ignore[no-any-return]


def split(words: list[str]) -> tuple[str, list[str]]:
    """The command that a line begins with, empty where there is none, and the words after it."""
    for count in (1, 2):
        path = " ".join(words[:count])
        if path in COMMANDS and len(words) >= count:
            return path, words[count:]
    return "", words
