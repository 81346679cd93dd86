"""Every command and where it is written: a new one is a function, and a line here."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

Command = Callable[..., None]

COMMANDS = {
    "up": "cli.run.up:up",
    "hub": "cli.run.hub:hub",
    "down": "cli.run.down:down",
    "status": "cli.run.status:status",
    "ps": "cli.run.status:status",
    "init": "cli.run.init:init",
    "demo": "cli.demo.demo:demo",
    "doctor": "cli.doctor.doctor:doctor",
    "console": "cli.console.console:console",
    "goto": "cli.lab.goto:goto",
    "fly": "cli.fly.fly:fly",
    "campaign": "cli.campaign.campaign:campaign",
    "fuzz": "cli.fuzz.fuzz:fuzz",
    "hold": "cli.lab.control:hold",
    "reset": "cli.lab.control:reset",
    "state": "cli.lab.state:state",
    "calibrate": "cli.lab.calibrate:calibrate",
    "cage on": "cli.lab.cage:on",
    "cage off": "cli.lab.cage:off",
    "cage show": "cli.lab.cage:show",
    "fleet list": "cli.fleet.list:list_",
    "fleet goto": "cli.fleet.goto:goto",
    "fleet hold": "cli.fleet.hold:hold",
    "fleet land-all": "cli.fleet.land:land_all",
    "record": "cli.record.record:record",
    "replay": "cli.record.replay:replay",
    "plot": "cli.plot.plot:plot",
    "bag info": "cli.bag.info:info",
    "bag check": "cli.bag.check:check",
    "bag repair": "cli.bag.repair:repair",
    "bag export": "cli.bag.export:export",
    "fault list": "cli.fault.fault:list_",
    "fault inject": "cli.fault.fault:inject",
    "fault clear": "cli.fault.fault:clear",
    "topic list": "cli.topic.list:list_",
    "topic info": "cli.topic.info:info",
    "topic echo": "cli.topic.echo:echo",
    "topic hz": "cli.topic.rates:hz",
    "topic bw": "cli.topic.rates:bw",
    "topic delay": "cli.topic.rates:delay",
    "topic pub": "cli.topic.pub:pub",
    "service list": "cli.service.list:list_",
    "service info": "cli.service.info:info",
    "service call": "cli.service.call:call",
    "param list": "cli.param.get:list_",
    "param get": "cli.param.get:get",
    "param set": "cli.param.set:set_",
    "param describe": "cli.param.describe:describe",
    "param dump": "cli.param.dump:dump",
    "param load": "cli.param.load:load",
    "param diff": "cli.param.diff:diff",
    "param save": "cli.param.save:save",
    "node list": "cli.node.list:list_",
    "node info": "cli.node.info:info",
    "node ping": "cli.node.ping:ping",
    "node logs": "cli.node.logs:logs",
    "node restart": "cli.node.restart:restart",
    "node kill": "cli.node.kill:kill",
    "keys init": "cli.keys.init:init",
    "keys issue": "cli.keys.issue:issue",
    "keys list": "cli.keys.list:list_",
    "keys revoke": "cli.keys.revoke:revoke",
    "type list": "cli.type.show:list_",
    "type show": "cli.type.show:show",
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
