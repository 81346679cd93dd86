"""Machine code of the vehicle's text, kept in the user's cache folder: made once, loaded by all.

Loading takes llvmlite alone, and 0.1 s; numba, which makes it, would take many times that.
"""

import ctypes
import hashlib
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from services.dynamics.fleet.single import FIXED, NUMBERS, Single, source
from services.runtime import generated
from services.runtime.realm import write_atomically

_Function = ctypes.PYFUNCTYPE(
    ctypes.c_int32, *[ctypes.c_void_p] * 4, ctypes.c_int64, ctypes.c_int64
)
"""As numba calls: where to put a result and an error, of which there is neither, then arguments.
The interpreter is kept meanwhile: other threads have no use for a few microseconds of it."""


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


class Machine:
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

    def single(self) -> Single:
        """What flies one vehicle."""
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
    return generated.folder() / f"vehicle_{hashlib.sha256(source().encode()).hexdigest()[:12]}.bin"
