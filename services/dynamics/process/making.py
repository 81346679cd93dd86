"""Makes the machine code of the vehicle's text: `python -P -m services.dynamics.process.making`.

It takes a while, so it has a process of its own, which gives way to all others and ends where its
stdin does: whoever wanted it is gone. Of several only the first makes it, the others wait.
"""

import os
import sys
import threading
import time

from services.dynamics.fleet.single import source
from services.dynamics.process.machine import Code, processor, store, stored, target
from services.runtime import generated
from services.runtime.errors import AlreadyServed
from services.runtime.filelock import FileLock
from services.runtime.shutdown import die_with_parent

_POLITE = 10
"""How far it gives way to others (of 19): the vehicles fly meanwhile."""
_A_LOOK = 0.5
"""Seconds after which another, who makes it, is looked after."""


def main() -> None:
    """Make it, unless another does."""
    die_with_parent()
    threading.Thread(target=_watch_stdin, daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(_POLITE)
    generated.folder().mkdir(parents=True, exist_ok=True)
    while stored() is None:
        try:
            with FileLock(generated.folder() / "vehicle.lock", "the compiler"):
                if stored() is None:
                    store(made())
        except AlreadyServed:
            time.sleep(_A_LOOK)
    os._exit(0)


def made() -> Code:
    """Compile the text, and translate it for this processor."""
    import llvmlite.binding as llvm

    (text,) = generated.load("vehicle", source()).fly.inspect_llvm().values()
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


if __name__ == "__main__":
    main()
