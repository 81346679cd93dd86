"""`record` and `up --record`: the file has every message and is complete."""

import json
import os
import resource
import signal
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
import zenoh
from mcap.reader import make_reader

from quadctl.services.runtime.recording.reader import Bag
from tests.support.bare import pack
from tests.support.lab import PATIENT, Lab, private_lab
from tests.support.running import Foreground, alive, eventually, is_frozen

BURST = 20_000


@pytest.fixture(scope="module")
def module_lab() -> Iterator[Lab]:
    """Running system that many tests record."""
    with private_lab() as made:
        patience = ("--set", "supervise.answer_timeout=60")
        made.start("--set", "dynamics.start.z=1", *patience, *PATIENT)
        yield made


def recording(lab: Lab, *words: object) -> Foreground:
    """Start `quadctl record` and wait until it records."""
    run = lab.spawn(*lab.command("record", *words))
    eventually(lambda: "recording" in run.log)
    return run


def recorder_of(run: Foreground) -> int:
    """Return the pid of the recorder process of a `record` command."""
    (pid,) = Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split()
    return int(pid)


def stop_and_log(run: Foreground, number: int = signal.SIGINT) -> str:
    run.send(number)
    assert run.wait() == 0, run.log
    return run.log


def has_grown(file: Path) -> bool:
    return file.stat().st_size > 10_000


def keys(path: Path) -> set[str]:
    return {message.key for message in Bag(path).messages()}


def test_ctrl_c_ends_a_recording_and_the_file_is_complete(module_lab: Lab):
    file = module_lab.folder / "a.mcap"
    run = recording(module_lab, "-o", "a.mcap")
    with module_lab.bare() as bare:
        bare.put("my/own", {"x": 1.5})
        bare.put("ghost/pose", {"not": "ours"})
        bare.session.put("my/text", "plain")
        assert bare.call("goto", x=1.0, y=0.5, z=1.0, replace=True).value["accepted"]
        assert bare.call("goto", x=99.0, y=0.5, z=1.0).value["accepted"] is False
        eventually(lambda: {"my/text", "uav/@call/goto"} <= keys(file))
    first, last = stop_and_log(run).splitlines()
    assert first == "recording to a.mcap; Ctrl-C ends it"
    assert last.startswith("a.mcap: ")
    assert keys(file) >= {
        "uav/pose", "uav/sensors/pressure", "uav/safety/state", "uav/input/position", "uav/info",
        "uav/@call/goto", "my/own", "my/text", "ghost/pose", "/tf", "/scene",
    }  # fmt: skip
    with file.open("rb") as data:
        for schema, channel, _ in make_reader(data, validate_crcs=True).iter_messages():
            ours = channel.topic[0] in "u/"
            assert (schema is not None) == ours, channel.topic
    said = {m.key: m.payload for m in Bag(file).messages()}
    assert (said["my/own"], said["my/text"]) == (pack({"x": 1.5}), b"plain")
    assert module_lab.quadctl("bag", "check", "a.mcap").code == 0
    again = module_lab.quadctl("record", "-o", "a.mcap", "--json")
    assert (again.code, again.error["message"]) == (6, "a.mcap already exists")


def test_an_unwritable_path_is_reported_and_nothing_is_left(module_lab: Lab):
    before = set(module_lab.home.glob("*recorder*"))
    done = module_lab.quadctl("record", "-o", "no/such/folder/a.mcap", "--json")
    assert (done.code, done.out, done.error["code"]) == (6, "", "invalid")
    assert done.error["message"].startswith("no/such/folder/a.mcap cannot be written: ")
    assert set(module_lab.home.glob("*recorder*")) == before


@pytest.mark.thorough
def test_a_recording_goes_on_after_the_run_is_restarted(lab: Lab):
    lab.start()
    run = recording(lab, "-o", "twice.mcap")
    first = lab.first_bare().state()["boot"]
    file = lab.folder / "twice.mcap"
    # It writes twice a second; a run that ended at once would leave no pose.
    eventually(lambda: boots(file) == {first})
    assert lab.quadctl("down").code == 0
    eventually(lambda: "the hub is gone: recording goes on when it is back\n" in run.log)
    lab.start()
    with lab.bare() as bare:
        second = bare.state()["boot"]
    eventually(lambda: boots(file) >= {first, second})
    _, *told, ended = stop_and_log(run).splitlines()
    assert [line.partition(":")[0] for line in told] == ["the hub is gone", "the hub is back"]
    assert ended.startswith("twice.mcap: ")
    assert lab.quadctl("bag", "check", "twice.mcap").code == 0


def boots(file: Path) -> set[str]:
    return {m.value["boot"] for m in Bag(file).messages() if m.key == "uav/pose"}


@pytest.mark.thorough
def test_a_recording_keeps_to_the_given_keys_and_duration(module_lab: Lab):
    words = ("pose", "uav/**", "-o", "b.mcap", "--duration", 0.5, "--json")
    done = module_lab.quadctl("record", *words)
    assert (done.code, done.err) == (0, "")
    *_, last = done.rows
    assert last["state"] == "done"
    assert {row["state"] for row in done.rows[:-1]} == {"recording"}
    there = [m for m in Bag(module_lab.folder / "b.mcap").messages() if not m.derived]
    assert last["messages"] == len(there)
    assert (last["lost"], last["file"]) == (0, "b.mcap")
    assert {m.key for m in there} >= {"uav/pose", "uav/input/position"}
    assert not any("@" in m.key for m in there)
    seqs = [m.value["seq"] for m in there if m.key == "uav/pose"]
    assert len(seqs) == len(set(seqs)), "a message that matches two patterns is recorded once"


@pytest.mark.thorough
def test_ten_thousand_messages_a_second_are_all_recorded(module_lab: Lab):
    run = recording(module_lab, "flood/*", "-o", "flood.mcap", "--json")
    payload = {"n": 0, "text": "small"}
    with module_lab.bare() as bare:
        publisher = bare.session.declare_publisher(
            "flood/x", congestion_control=zenoh.CongestionControl.BLOCK
        )
        began = time.monotonic()
        for number in range(BURST):
            payload["n"] = number
            publisher.put(pack(payload))
            if number % 100 == 0:
                time.sleep(max(began + number / 10_000 - time.monotonic(), 0))
        eventually(lambda: f'"messages":{BURST},' in run.log, 60.0)
    facts = json.loads(stop_and_log(run).splitlines()[-1])
    assert (facts["messages"], facts["lost"]) == (BURST, 0)
    numbers = [m.value["n"] for m in Bag(module_lab.folder / "flood.mcap").messages()]
    assert numbers == list(range(BURST))


@pytest.mark.thorough
def test_a_recording_cut_by_sigkill_can_be_repaired(module_lab: Lab):
    file = module_lab.folder / "killed.mcap"
    run = recording(module_lab, "-o", file)
    eventually(partial(has_grown, file))
    os.kill(recorder_of(run), signal.SIGKILL)
    assert run.wait() == 1
    assert f"`quadctl bag repair {file}` recovers what it has recorded" in run.log
    info = module_lab.quadctl("bag", "info", file)
    assert info.code == 0
    assert "it is cut" in info.err
    assert module_lab.quadctl("bag", "check", file).code == 8
    mended = module_lab.quadctl("bag", "repair", file, "--json")
    assert mended.json["messages"] == len(list(Bag(file).messages())) > 50
    assert module_lab.quadctl("bag", "check", file).code == 0


@pytest.mark.prove
def test_a_recording_cut_by_sigkill_loses_half_a_second_at_most(module_lab: Lab):
    for number in range(10):
        file = module_lab.folder / f"k{number}.mcap"
        run = recording(module_lab, "pose", "-o", file)
        eventually(partial(has_grown, file))
        with module_lab.bare() as bare:
            # Kill at a different time between two chunks in each round.
            bare.watch("uav/pose").next(3 * number + 1)
        pid = recorder_of(run)
        killed = time.time()
        os.kill(pid, signal.SIGKILL)
        run.wait()
        last = max(message.at for message in Bag(file).messages()) / 1e9
        print(f"lost {killed - last:.3f} s")
        assert killed - last < 0.5


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_the_recorder_ends_with_its_command_with_a_complete_file(module_lab: Lab, number: int):
    file = module_lab.folder / f"orphan{number}.mcap"
    run = recording(module_lab, "-o", file)
    recorder = recorder_of(run)
    run.send(number)
    run.wait()
    eventually(lambda: not alive(recorder))
    assert module_lab.quadctl("bag", "check", file).code == 0


def test_a_full_disk_stops_the_recording_and_never_the_flight(module_lab: Lab):
    before = module_lab.nodes()
    file = module_lab.folder / "full.mcap"
    run = recording(module_lab, "-o", file, "--json")
    size = file.stat().st_size + 10_000
    resource.prlimit(recorder_of(run), resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    assert run.wait() == 1
    error = json.loads(run.log.splitlines()[-1])["error"]
    assert error["message"].startswith(f"the recording has stopped: {file} cannot be written")
    assert f"quadctl bag repair {file}" in error["hint"]
    assert "Traceback" not in run.log
    assert module_lab.quadctl("bag", "repair", file).code == 0
    assert module_lab.quadctl("bag", "check", file).code == 0
    assert module_lab.nodes() == before
    assert module_lab.quadctl("goto", 0, 0, 1, "--no-wait", "--replace").code == 0


@pytest.mark.thorough
def test_a_frozen_hub_ends_record_by_its_timeout(module_lab: Lab):
    with module_lab.frozen("hub"):
        done = module_lab.quadctl("record", "-o", "never.mcap", "--timeout", 0.4, "--json")
    assert (done.code, done.error["code"]) == (4, "timeout")
    assert not (module_lab.folder / "never.mcap").exists()
    eventually(lambda: module_lab.quadctl("state").code == 0)


@pytest.mark.thorough
def test_a_restarted_recorder_of_a_run_uses_a_new_file(lab: Lab):
    lab.start("--record", "run.mcap", "--set", "dynamics.start.z=1")
    assert list(lab.nodes()) == ["hub", "dynamics", "pressure", "safety", "recorder"]
    for taken in ("run.mcap", "nowhere/run.mcap"):
        assert lab.quadctl("up", "-d", "--record", taken, "--json").error["code"] == "invalid"
    first = lab.folder / "run.mcap"
    eventually(lambda: "uav/safety/state" in keys(first))
    # A second recording may run at the same time.
    assert lab.quadctl("record", "-d", 0.3, "-o", "other.mcap").code == 0
    lab.revived("recorder", lab.signal("recorder", signal.SIGKILL))
    second = lab.folder / "run-1.mcap"
    eventually(lambda: "uav/pose" in keys(second))
    assert lab.nodes()["safety"]["restarts"] == 0
    eventually(lambda: f"recording to {second}" in lab.log("recorder"))
    assert lab.quadctl("down").code == 0
    assert lab.quadctl("bag", "check", second).code == 0
    assert lab.quadctl("bag", "repair", first).code == 0
    notes = Bag(second)
    list(notes.messages())
    assert json.loads(notes.notes["quadctl"]["params"])["dynamics"]["start"]["z"] == 1


def test_a_recording_in_use_is_not_repaired_and_a_removed_one_is_reported(module_lab: Lab):
    file = module_lab.folder / "removed.mcap"
    run = recording(module_lab, "-o", file)
    eventually(lambda: has_grown(file))
    assert "cut: it is still being recorded" in module_lab.quadctl("bag", "info", file).err
    refused = module_lab.quadctl("bag", "repair", file)
    assert refused.code == 7
    assert "still being recorded" in refused.err
    assert "Traceback" not in run.log
    file.unlink()
    assert run.wait() == 1
    assert f"another program has removed or replaced {file}" in run.log


@pytest.mark.thorough
def test_a_ctrl_c_while_the_recorder_starts_leaves_nothing_or_a_whole_file(module_lab: Lab):
    for number in range(8):
        file = module_lab.folder / f"early{number}.mcap"
        run = module_lab.spawn(*module_lab.command("record", "-o", file))
        children = Path(f"/proc/{run.pid}/task/{run.pid}/children")
        eventually(children.read_text)
        time.sleep(0.03 * number)  # into its imports
        run.send(signal.SIGINT)
        code = run.wait()
        assert (code, file.exists()) in {(130, False), (0, True)}, run.log
        assert "Traceback" not in run.log
        assert code or Bag(file).problem == ""


def test_a_recording_is_complete_though_nobody_read_its_last_report(module_lab: Lab):
    file = module_lab.folder / "no_report.mcap"
    run = recording(module_lab, "-o", file, "--json")
    recorder = recorder_of(run)
    with Path(f"/proc/{recorder}/fd/1").open("rb") as pipe:
        run.send(signal.SIGSTOP)
        eventually(lambda: is_frozen(run.pid))
        os.kill(recorder, signal.SIGINT)
        assert pipe.read(), "instead of the command"
        run.send(signal.SIGCONT)
    assert run.wait() == 0, run.log
    last = json.loads(run.log.splitlines()[-1])
    there = [message for message in Bag(file).messages() if not message.derived]
    assert (last["state"], last["messages"]) == ("done", len(there))
    assert last["keys"] == len({message.key for message in there})


@pytest.mark.thorough
def test_a_file_that_is_moved_is_completed_and_reported(module_lab: Lab):
    file, moved = module_lab.folder / "before.mcap", module_lab.folder / "after.mcap"
    run = recording(module_lab, "-o", file)
    eventually(lambda: has_grown(file))
    file.rename(moved)
    run.send(signal.SIGINT)
    assert run.wait() == 1
    assert f"{file} was moved while it was recorded" in run.log
    bag = Bag(moved)
    assert len(list(bag.messages())) > 10
    assert bag.problem == ""
