"""Compilation of the vehicle's model in the background, and the cache of its machine code.

Loading takes only llvmlite, and 0.1 s. Compiling takes numba and many times as long, so it runs in
a separate process with low priority, which ends when its stdin is closed. Of several such processes
one compiles, the others wait.
"""

import ctypes
import hashlib
import logging
import os
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
from msgspec import Struct

from quadctl.schemas.typed import converted
from quadctl.services.runtime.filelock import turn
from quadctl.services.runtime.realm import write_atomically
from quadctl.services.runtime.shutdown import die_with_parent

if TYPE_CHECKING:
    from quadctl.services.dynamics.compiled.aot import CompiledModel

_log = logging.getLogger(__name__)
_MAKING = (sys.executable, "-P", "-m", "quadctl.services.dynamics.compiler")
_Function = ctypes.PYFUNCTYPE(ctypes.c_int32, *[ctypes.c_void_p] * 5, *[ctypes.c_int64] * 3)
"""Signature of numba's code: pointers for a result and an error, both unused, then arguments. It
keeps the GIL: other threads have no use for a few microseconds of it."""
_NO_MEMORY = "define linkonce_odr void @NRT_MemInfo_call_dtor(ptr %memory) { ret void }"
"""Numba's release of an array: it is not there where the code runs, and the arrays are Python's."""
_POLITE = 10
"""Nice level of the compiler (of 19): the vehicles keep flying."""


class Code(Struct, frozen=True):
    """Content of a cache file: code for one kind of processor, and the name of its function."""

    processor: str
    function: str
    machine: bytes
    digest: str

    @staticmethod
    def sealed(processor: str, function: str, machine: bytes) -> "Code":
        """Return code with its digest, which reveals a damaged file."""
        return Code(processor, function, machine, hashlib.sha256(machine).hexdigest())


class _MachineCode:
    """Loaded machine code."""

    def __init__(self, code: Code) -> None:
        """Load the code."""
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target())
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(code.machine))
        self._engine.finalize_object()
        self._function = _Function(self._engine.get_function_address(code.function))
        self._unused = ctypes.create_string_buffer(8)
        self._places: tuple[int, ...] = ()

    def use(self, numbers: bytearray, fixed: bytearray, block: bytearray) -> None:
        """Fly these vehicles from now on, see `aot.FlightCode`."""
        from quadctl.services.dynamics.compiled.aot import LINE

        self._memory = [
            (ctypes.c_char * len(each)).from_buffer(each) for each in (numbers, fixed, block)
        ]
        unused, first, second, third = map(ctypes.addressof, (self._unused, *self._memory))
        self._places = unused, unused, first, second, third + -third % LINE

    def fly(self, count: int, start: int, steps: int) -> None:
        """Fly the first so many vehicles, see `aot.FlightCode`."""
        self._function(*self._places, count, start, steps)


def load(code: Code) -> "CompiledModel":
    """Return the compiled model."""
    from quadctl.services.dynamics.compiled.aot import CompiledModel

    return CompiledModel(_MachineCode(code))


def stored() -> Code | None:
    """Return the code for this processor, None if there is none."""
    try:
        code = converted(msgspec.msgpack.decode(_path().read_bytes()), Code)
    except (FileNotFoundError, msgspec.DecodeError):
        return None
    sound = hashlib.sha256(code.machine).hexdigest() == code.digest
    return code if sound and code.processor == processor() else None


def store(code: Code) -> None:
    """Write the code to the cache."""
    write_atomically(_path(), msgspec.msgpack.encode(code))


def processor() -> str:
    """Return LLVM's name and features of this processor."""
    import llvmlite.binding as llvm

    return f"{llvm.get_host_cpu_name()} {llvm.get_host_cpu_features().flatten()}"


def target() -> Any:
    """Return llvmlite's TargetMachine of this processor."""
    import llvmlite.binding as llvm

    name, features = processor().split(maxsplit=1)
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=name, features=features, opt=3, jit=True
    )


def _path() -> Path:
    # Imported here: a process with one vehicle in plain Python does not need it.
    from quadctl.services.dynamics.compiled.aot import aot_source
    from quadctl.services.dynamics.compiled.source import cache_folder

    return cache_folder() / f"vehicle_{hashlib.sha256(aot_source().encode()).hexdigest()[:12]}.bin"


def main() -> None:
    """Make the machine code, unless another process does."""
    die_with_parent()
    threading.Thread(target=_watch_stdin, daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(_POLITE)
    compile_once()
    os._exit(0)


def compile_once() -> None:
    """Store the machine code, unless it is there; of several processes one compiles."""
    from quadctl.services.dynamics.compiled.source import cache_folder

    with turn(cache_folder() / "vehicle.lock"):
        if stored() is None:
            store(made())


def made() -> Code:
    """Compile the model for this processor."""
    import llvmlite.binding as llvm

    from quadctl.services.dynamics.compiled.aot import aot_source
    from quadctl.services.dynamics.compiled.source import load_module

    (text,) = load_module("vehicle", aot_source()).fly.inspect_llvm().values()
    module, machine = llvm.parse_assembly(text), target()
    module.link_in(llvm.parse_assembly(_NO_MEMORY))
    # Keep the exported function and its callees; drop numba's own.
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    (function,) = (
        each.name
        for each in module.functions
        if not each.is_declaration and each.linkage == llvm.Linkage.external
    )
    return Code.sealed(processor(), function, machine.emit_object(module))


def _watch_stdin() -> None:
    # Not by sys.stdin: its lock would turn any error of this process into a fatal one.
    while os.read(0, 4096):
        pass
    os._exit(1)


def is_due() -> bool:
    """Return whether the vehicle is not compiled yet; never, without the extra `fleet`."""
    return _has_numba() and stored() is None


def _has_numba() -> bool:
    # Imported here: one vehicle in real time does not need it.
    from importlib.util import find_spec

    return find_spec("numba") is not None


def have_made() -> None:
    """Run the compiler process, if needed, and wait until it has ended or failed."""
    import subprocess

    # The process ends with its stdin, at the latest when this process ends. Numba reads a file of
    # settings in its working directory, which may be a hand-in's.
    with subprocess.Popen(_MAKING, stdin=subprocess.PIPE, cwd="/") as making:
        making.wait()


class BackgroundCompiler:
    """Loader of the machine code in the background; compiles it first if needed.

    Without the extra `fleet` there is none, and vehicles fly as plain Python: the same flight.
    """

    def __init__(self) -> None:
        self.model: CompiledModel | None = None
        """The compiled model, None until there is one."""
        self._once = threading.Lock()

    def start(self) -> None:
        """Begin, unless begun already; safe to call from any thread."""
        if self._once.acquire(blocking=False):
            threading.Thread(target=self._fetch, name="compiler", daemon=True).start()

    def _fetch(self) -> None:
        if not _has_numba():
            return
        code = stored()
        if code is None:
            _log.info("compiling the vehicle, once for this machine; until then it flies slower")
            have_made()
            code = stored()
        if code is None:
            _log.warning("the vehicle could not be compiled: it keeps flying as plain Python")
            return
        self.model = load(code)
        _log.info("the vehicle flies compiled")


if __name__ == "__main__":
    main()
