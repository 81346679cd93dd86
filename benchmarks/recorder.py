"""The recorder's cost, and its highest rate."""

import itertools
import json
import signal
import subprocess
import time

import zenoh

from benchmarks.children import Failed
from benchmarks.effort import Effort
from benchmarks.footprint import shares
from benchmarks.ours.node import pose
from benchmarks.results import Results
from benchmarks.system import QUADCTL, Home, home, running
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.session import Address, open_client
from quadctl.services.runtime.recording.framing import summary

_HUB_ALONE = ("--without", "dynamics", "--without", "pressure", "--without", "safety")
_SETTLED = 10.0
_FLOOD_SECONDS = 2.0
_LONGEST = 10.0
_ENCODING = codec.encoding(type(pose(0)))


def measure(results: Results, effort: Effort) -> None:
    """Measure the recorder's share of a core in flight, and its rate in a flood of poses."""
    with home() as where:
        where.quadctl("up", "-d", "--record", str(where.folder / "flight.mcap"))
        time.sleep(_SETTLED)
        found = shares(where, effort.seconds, fly=True)
        results.notes["recorder_processor"] = found
        results.add("recorder_processor", "ours", [found["recorder"]])
    for run in range(effort.runs):
        with running(*_HUB_ALONE) as where:
            results.add("recorder_rate", "ours", [_rate(where)], run=run)


def _rate(where: Home) -> float:
    """Return the rate (1/s) of typed messages put without pause; raise Failed if one is lost."""
    file = where.folder / "flood.mcap"
    command = [QUADCTL, "record", "flood/*", "-o", str(file), "--json"]
    recorder = subprocess.Popen(command, env=where.environment, stdout=subprocess.PIPE)
    assert recorder.stdout is not None
    recorder.stdout.readline()
    with open_client(Address(where.endpoint)) as session:
        publisher = session.declare_publisher(
            "flood/pose", encoding=_ENCODING, congestion_control=zenoh.CongestionControl.BLOCK
        )
        end = time.monotonic() + _FLOOD_SECONDS
        for sent in itertools.count(1):
            publisher.put(codec.encode(pose(sent)))
            if time.monotonic() > end:
                break
        # Wait for messages in transit: the recorder reports its count once a second.
        for line in recorder.stdout:
            if json.loads(line)["messages"] >= sent or time.monotonic() > end + _LONGEST:
                break
    recorder.send_signal(signal.SIGINT)
    facts = json.loads(recorder.communicate()[0].splitlines()[-1])
    found = summary(file)
    if facts["messages"] != sent or found is None or found.statistics is None:
        raise Failed(f"of {sent} messages {facts['messages']} were recorded")
    first, last = found.statistics.message_start_time, found.statistics.message_end_time
    return (sent - 1) / ((last - first) / 1e9)
