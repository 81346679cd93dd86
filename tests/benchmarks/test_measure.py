import json
import os

import pytest

from benchmarks import measure, parts
from benchmarks.children import PYTHON, Failed, workers
from benchmarks.parts import Part

HOLDS, BAR, MISSES = 60.0, 65.0, 70.0


@pytest.fixture
def pretended(monkeypatch):
    """Pretend runs in which a part reports a value, or fails, instead of measuring."""

    def pretend(**values):
        def part(key, value):
            def claim(results, _effort):
                if isinstance(value, Exception):
                    raise value
                results.add(key, "ours", [value])

            return Part("commands", (key,), claim)

        monkeypatch.setattr(parts, "PARTS", tuple(part(*each) for each in values.items()))

    return pretend


def only(found, *keys):
    """Return the document with only these rows; a row that no part has measured would fail."""
    return found | {"figures": [entry for entry in found["figures"] if entry["key"] in keys]}


@pytest.mark.thorough
def test_a_failed_row_is_reported_and_does_not_stop_the_others(pretended, capsys):
    pretended(param_get=RuntimeError("it broke"), type_show=HOLDS - 20)
    found = measure.run(["commands"], measure.QUICK)
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].endswith("FAILED: RuntimeError: it broke")
    assert "HOLDS" in printed[1]
    assert measure.verdict(only(found, "param_get", "type_show")) == 1
    assert measure.verdict(only(found, "type_show")) == 0


@pytest.mark.thorough
@pytest.mark.parametrize(("value", "code"), [(HOLDS, 0), (BAR, 0), (MISSES, 1)])
def test_a_run_and_its_file_are_judged_by_the_same_bars(pretended, tmp_path, capsys, value, code):
    pretended(param_get=value)
    found = only(measure.run(["commands"], measure.QUICK), "param_get")
    assert measure.verdict(found) == code
    capsys.readouterr()
    file = tmp_path / "figures.json"
    file.write_text(json.dumps(found))
    assert measure.main(["--file", str(file), "--check"]) == code
    assert measure.main(["--file", str(file)]) == 0
    assert ("missed: `param get`" in capsys.readouterr().err) == bool(code)


@pytest.mark.thorough
def test_the_file_describes_the_machine(pretended, tmp_path):
    pretended(param_get=HOLDS)
    file = tmp_path / "figures.json"
    # The group's other rows were not measured.
    assert measure.main(["--only", "commands", "--check", "--out", str(file)]) == 1
    machine = json.loads(file.read_bytes())["machine"]
    assert {"commit", "date", "processor", "python", "packages"} <= machine.keys()
    assert {"eclipse-zenoh", "msgspec"} <= machine["packages"].keys()
    assert all(machine["speeds"][name] > 0 for name in ("loop", "read", "wake"))


def test_a_partial_run_never_overwrites_the_file(capsys):
    with pytest.raises(SystemExit) as left:
        measure.main(["--only", "commands", "--write"])
    assert left.value.code == 2


def test_a_worker_answers_a_request_and_ends():
    loop = "from benchmarks.worker import serve; import os; serve(pid=os.getpid)"
    with workers(([*PYTHON[:-1], "-c", loop], dict(os.environ))) as (worker,):
        pid = worker.ask("pid")
        os.kill(pid, 0)
        with pytest.raises(Failed, match="KeyError"):
            worker.ask("what")
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
