"""The peers' own Python environments, below .cache: made when first asked for."""

import os
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).parents[2]
_HOME = ROOT / ".cache" / "peers"

PACKAGES = {
    "rotorpy": ("rotorpy==3.0.0", "torch", "torchdiffeq", "roma"),
    "mujoco": ("mujoco==4.0.0", "numpy"),
    "crazyflow": ("crazyflow==0.4.0",),
}
"""What pip installs for each."""


class Missing(Exception):
    """A peer cannot be had on this machine."""


def python(peer: str) -> Path:
    """The interpreter of a peer's environment, with the peer in it; raises Missing."""
    folder = _HOME / peer
    interpreter = folder / "bin" / "python"
    ready = folder / ".ready"
    wanted = " ".join(PACKAGES[peer])
    if not (ready.exists() and ready.read_text(encoding="utf-8") == wanted):
        print(f"installing {wanted} into {folder.relative_to(ROOT)}", file=sys.stderr)
        venv.create(folder, clear=True, with_pip=True)
        command = [str(interpreter), "-m", "pip", "install", "--quiet", *PACKAGES[peer]]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise Missing(f"pip install {wanted}: {done.stderr.strip().splitlines()[-1]}")
        ready.write_text(wanted, encoding="utf-8")
    return interpreter


def run(peer: str, module: str, *arguments: str) -> str:
    """What a module of peers/ prints in a peer's environment; raises Missing where it fails."""
    command = [str(python(peer)), "-m", f"benchmarks.model.peers.{module}", *arguments]
    # One thread each: vehicle-steps per second are those of one core.
    one = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    environment = os.environ | one | {"JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise Missing(f"{peer}: {done.stderr.strip().splitlines()[-1:]}")
    return done.stdout.strip().splitlines()[-1]
