"""Lines that users of ROS 1, ROS 2 and PX4 type after `quadctl`, and what each leads to."""

import re
import shlex

import pytest

from quadctl.cli import parser
from quadctl.cli.commands import command
from quadctl.cli.habits import INSTEAD, OPTIONS, translated
from tests.support.command_line import Quadctl, command_of

WORKS = {
    "topic list": "topic list",
    "topic list -v": "topic list",
    "topic list --verbose": "topic list",
    "topic echo /uav/pose": "topic echo",
    "topic echo /uav/pose --once": "topic echo",
    "topic echo -n 3 /uav/sensors/pressure": "topic echo",
    "topic echo -n1 /uav/pose/position/z": "topic echo",
    "topic echo /uav/pose --field position.x": "topic echo",
    "topic hz /uav/pose": "topic hz",
    "topic hz -w 50 /uav/pose": "topic hz",
    "topic bw /uav/pose": "topic bw",
    "topic delay /uav/pose": "topic delay",
    "topic info /uav/pose": "topic info",
    "topic type /uav/pose": "topic info",
    "topic pub -1 /uav/input/position_request geometry_msgs/Vector3 '{x: 1, y: 2, z: 1}'": "topic pub",
    "topic pub --once /uav/input/position_request geometry_msgs/Vector3 '{x: 1}'": "topic pub",
    "topic pub -r 10 /uav/own/x std_msgs/Float64 'data: 1'": "topic pub",
    "topic pub --rate 10 /uav/own/x 1": "topic pub",
    "service list": "service list",
    "service info /uav/calibrate_pressure": "service info",
    "service type /calibrate_pressure": "service info",
    "service call /calibrate_pressure True": "service call",
    "service call /toggle_cage std_srvs/srv/SetBool '{cage_on: false}'": "service call",
    "param list": "param list",
    "param list /safety": "param list",
    "param get /safety takeoff": "param get",
    "param get /safety/takeoff": "param get",
    "param set /safety takeoff 1.5": "param set",
    "param set /safety/takeoff 1.5": "param set",
    "param describe /safety takeoff": "param describe",
    "param dump": "param dump",
    "param dump -o lab.toml": "param dump",
    "param load lab.toml": "param load",
    "node list": "node list",
    "node info /safety": "node info",
    "node ping /safety": "node ping",
    "node ping --all": "node ping",
    "node kill /safety": "node kill",
    "interface show Pose": "type show",
    "interface show geometry_msgs/msg/Vector3": "type show",
    "interface list": "type list",
    "msg show Pose": "type show",
    "msg list": "type list",
    "srv show calibrate": "type show",
    "srv list": "type list",
    "bag record": "record",
    "bag record -a": "record",
    "bag record -o flight.mcap /uav/pose": "record",
    "record -a": "record",
    "bag play flight.mcap": "replay",
    "bag play --clock flight.mcap": "replay",
    "play flight.mcap": "replay",
    "bag info flight.mcap": "bag info",
    "bag check flight.mcap": "bag check",
    "bag reindex flight.mcap": "bag repair",
    "graph": "graph",
    "rqt_graph": "graph",
    "wtf": "doctor",
    "doctor": "doctor",
}
"""Command that a line runs."""

NAMES = {
    "launch lab lab.launch": "quadctl up -d",
    "run lab safety_node": "quadctl up -d",
    "core": "quadctl hub -d",
    "daemon status": "quadctl status",
    "rqt": "quadctl console",
    "rqt_plot": "quadctl plot",
    "rviz": "quadctl console",
    "tf tf_echo map base_link": "quadctl topic echo pose",
    "topic find geometry_msgs/Vector3": "quadctl topic list",
    "service find std_srvs/SetBool": "quadctl service list",
    "service uri /toggle_cage": "quadctl service info",
    "topic echo -p /uav/pose": "quadctl bag export",
    "topic echo /uav/pose --csv": "quadctl bag export",
    "bag play -r 2 flight.mcap": "--speed 2",
    "bag play -s 5 flight.mcap": "--from 5",
    "bag play -l flight.mcap": "quadctl replay",
    "bag record -O flight.mcap": "quadctl record -o",
    "bag filter a.mcap b.mcap": "quadctl record",
    "bag convert -i a": "quadctl bag export",
    "param delete /safety takeoff": "quadctl param describe",
    "up acceptance_range:=0.25": "quadctl up --set safety.acceptance_range=0.25",
    "lifecycle set /safety shutdown": "quadctl node restart",
    "action send_goal /goto": "quadctl goto",
    "pkg list": "quadctl --version",
    "arm": "quadctl goto",
    "takeoff": "quadctl goto",
    "land": "quadctl goto X Y 0",
    "stop": "quadctl hold",
}
"""Part of the hint that a line prints."""


def test_there_are_enough_habits():
    assert len(WORKS) + len(NAMES) >= 85


@pytest.mark.parametrize("line", WORKS)
def test_a_line_with_one_obvious_meaning_is_ours(line: str):
    assert parser.read(translated(shlex.split(line))).command is command(WORKS[line])


@pytest.mark.parametrize("line", NAMES)
def test_any_other_line_is_answered_with_the_command_to_type(quadctl: Quadctl, line: str):
    result = quadctl(*shlex.split(line))
    assert result.code == 2
    assert NAMES[line] in result.err.partition("try: ")[2]


def test_every_hint_names_commands_that_exist():
    for path in INSTEAD:
        assert not command_of(path), path
    for path, hint in [*INSTEAD.items(), *OPTIONS.items()]:
        named = re.findall(r"`quadctl ([^`]+)`", hint)
        assert named, path
        for line in named:
            assert command_of(line) or line.startswith("--"), (path, line)
