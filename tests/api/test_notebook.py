"""The notebook in examples/, run cell by cell in a kernel of its own."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parents[2] / "examples" / "two_missions.ipynb"


@pytest.mark.thorough
def test_the_notebook_flies_draws_and_compares_two_missions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    for variable in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(variable, str(tmp_path / variable.lower()))
    notebook = nbformat.read(NOTEBOOK, as_version=4)  # type: ignore[no-untyped-call]
    assert not any(cell.get("outputs") for cell in notebook.cells), "saved without outputs"
    NotebookClient(notebook, timeout=60, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 1
    rows = [line.split() for line in outputs[-1]["text"].splitlines()[1:]]
    times = {name: float(seconds) for name, seconds, _way, _top in rows}
    assert set(times) == {"lab", "slow"}
    assert times["slow"] > times["lab"] > 0
    assert {path.name for path in tmp_path.glob("*.mcap")} == {"lab.mcap", "slow.mcap"}
