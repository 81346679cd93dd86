"""Compilation of one vehicle in the background, and the cache of its machine code.

Loading takes llvmlite alone, and 0.1 s; numba, which makes the code, would take many times that: it
runs in a process of its own, which gives way to all others and ends when its stdin is closed. Of
several such processes one compiles, the others wait.
"""

import ctypes
import hashlib
import logging
import os
import sys
import threading
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
from msgspec import Struct

from quadctl.services.runtime.errors import AlreadyServed
from quadctl.services.runtime.filelock import FileLock
from quadctl.services.runtime.realm import write_atomically
from quadctl.services.runtime.shutdown import die_with_parent

if TYPE_CHECKING:
    from quadctl.services.dynamics.compiled.single import Single

_log = logging.getLogger(__name__)
_MAKING = (sys.executable, "-P", "-m", "quadctl.services.dynamics.compiler")
_Function = ctypes.PYFUNCTYPE(
    ctypes.c_int32, *[ctypes.c_void_p] * 4, ctypes.c_int64, ctypes.c_int64
)
"""As numba calls: where to put a result and an error, of which there is neither, then arguments.
The interpreter is kept meanwhile: other threads have no use for a few microseconds of it."""
_POLITE = 10
"""How far it gives way to others (of 19): the vehicles fly meanwhile."""
_A_LOOK = 0.5
"""Seconds after which another, who makes it, is looked after."""


class Code(Struct, frozen=True):
    """What a file holds: code of one kind of processor, and the name of its function."""

    processor: str
    function: str
    machine: bytes
    digest: str

    @staticmethod
    def sealed(processor: str, function: str, machine: bytes) -> "Code":
        """With the digest by which a damaged file is told."""
        return Code(processor, function, machine, hashlib.sha256(machine).hexdigest())


class MachineCode:
    """Loaded code."""

    def __init__(self, code: Code) -> None:
        """Make it ready to be called."""
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target())
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(code.machine))
        self._engine.finalize_object()
        self._function = _Function(self._engine.get_function_address(code.function))
        self._nowhere = ctypes.create_string_buffer(8)

    def single(self) -> "Single":
        """Return one vehicle's flight through the compiled text."""
        from quadctl.services.dynamics.compiled.single import FIXED, NUMBERS, Single

        numbers, fixed = (ctypes.create_string_buffer(of.size) for of in (NUMBERS, FIXED))
        places = (ctypes.addressof(each) for each in (self._nowhere, self._nowhere, numbers, fixed))
        return Single(partial(self._function, *places), numbers, fixed)


def stored() -> Code | None:
    """The code for this processor, where it has been made."""
    try:
        code = msgspec.msgpack.decode(_path().read_bytes(), type=Code)
    except (FileNotFoundError, msgspec.DecodeError):
        return None
    sound = hashlib.sha256(code.machine).hexdigest() == code.digest
    return code if sound and code.processor == processor() else None


def store(code: Code) -> None:
    """Keep it for the next time."""
    _path().parent.mkdir(parents=True, exist_ok=True)
    write_atomically(_path(), msgspec.msgpack.encode(code))


def processor() -> str:
    """This one, as LLVM knows it."""
    import llvmlite.binding as llvm

    return f"{llvm.get_host_cpu_name()} {llvm.get_host_cpu_features().flatten()}"


def target() -> Any:
    """What LLVM is to write code for: this processor, as a TargetMachine of llvmlite."""
    import llvmlite.binding as llvm

    name, features = processor().split(maxsplit=1)
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=name, features=features, opt=3, jit=True
    )


def _path() -> Path:
    # Imported here: a process whose one vehicle flies as plain Python needs none of it.
    from quadctl.services.dynamics.compiled.single import single_source
    from quadctl.services.dynamics.compiled.source import cache_folder

    return (
        cache_folder() / f"vehicle_{hashlib.sha256(single_source().encode()).hexdigest()[:12]}.bin"
    )


def main() -> None:
    """Make the machine code, unless another process does."""
    from quadctl.services.dynamics.compiled.source import cache_folder

    die_with_parent()
    threading.Thread(target=_watch_stdin, daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(_POLITE)
    cache_folder().mkdir(parents=True, exist_ok=True)
    while stored() is None:
        try:
            with FileLock(cache_folder() / "vehicle.lock", "the compiler"):
                if stored() is None:
                    store(made())
        except AlreadyServed:
            time.sleep(_A_LOOK)
    os._exit(0)


def made() -> Code:
    """Compile the text, and translate it for this processor."""
    import llvmlite.binding as llvm

    from quadctl.services.dynamics.compiled.single import single_source
    from quadctl.services.dynamics.compiled.source import load_module

    (text,) = load_module("vehicle", single_source()).fly.inspect_llvm().values()
    module, machine = llvm.parse_assembly(text), target()
    # Left are the function that can be called and what it calls: nothing of numba's own.
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
    sys.stdin.buffer.read()
    os._exit(1)


def have_made() -> None:
    """Have the machine code made where there is none; returns when that is done, or has failed."""
    import subprocess

    # It ends when its stdin does, which is at the latest when we do.
    with subprocess.Popen(_MAKING, stdin=subprocess.PIPE) as making:
        making.wait()


class BackgroundCompiler:
    """Loads the machine code in the background, and has it made where it has not been yet.

    Without the extra `fleet` there is none, and vehicles fly as plain Python: the same flight.
    """

    def __init__(self) -> None:
        self._machine: MachineCode | None = None
        self._asking = threading.Lock()

    def start(self) -> None:
        """Begin, unless somebody has; safe to call from any thread."""
        if self._asking.acquire(blocking=False):
            threading.Thread(target=self._fetch, name="compiler", daemon=True).start()

    def single(self) -> "Single | None":
        """What flies one vehicle; None while there is nothing yet."""
        return self._machine.single() if self._machine else None

    def _fetch(self) -> None:
        # Loaded here, in the background: one vehicle in real time needs none of it.
        from importlib.util import find_spec

        if find_spec("numba") is None:
            return

        code = stored()
        if code is None:
            _log.info("compiling the vehicle, once for this machine; it flies meanwhile")
            have_made()
            code = stored()
        if code is None:
            _log.warning("the vehicle could not be compiled: it flies on as plain Python")
            return
        self._machine = MachineCode(code)
        _log.info("the vehicle flies compiled")


if __name__ == "__main__":
    main()
