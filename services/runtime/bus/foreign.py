"""Zenoh's threads, as Python knows them."""

import ctypes
import threading

_known = threading.local()


def stay() -> None:
    """Let this thread of Zenoh's keep its place in the interpreter; first thing in a callback.

    The binding makes a thread state for each callback and drops it afterwards: with the memory
    mapped and unmapped for it, some 40 us a message. One hold more than is let go keeps it.
    """
    try:
        _known.here  # noqa: B018 - asked so with each message, for which hasattr takes too long
    except AttributeError:
        _known.here = True
        ctypes.pythonapi.PyGILState_Ensure()
