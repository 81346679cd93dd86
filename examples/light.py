"""Service of a bare Zenoh program, without the package of quadctl: a light that is on or off.

docs/how-to/own-service.md explains it; [processes] of quad.toml starts it.
"""

import json
import os
import threading
import time

import msgspec
import zenoh

KEY = "uav/@srv/own/light"
TOKENS = "uav/@node/own-light/@srv/Light/00000001/0/uav%@srv%own%light", "uav/@node/own-light"
answers: dict[str, bytes] = {}  # replies of the last 1024 executed calls, by id


class Call(msgspec.Struct):
    """Attachment of a call: its id, its deadline (Unix time, s), and a simulated time."""

    id: str
    deadline: float
    at: float | None = None


class Request(msgspec.Struct, forbid_unknown_fields=True):
    """Request of the service: the light on or off."""

    on: bool


def answer(query: zenoh.Query) -> bytes:
    """Execute a call once, and return its reply; raise for one that must not be executed."""
    ticket = query.attachment.to_bytes() if query.attachment else None
    call = msgspec.msgpack.decode(ticket, type=Call) if ticket else None
    if call and call.id in answers:
        return answers[call.id]
    if call and call.at is not None:
        raise ValueError("this program executes no call at a simulated time")
    if call and call.deadline < time.time():
        raise TimeoutError("the call came after its deadline and was not executed")
    request = msgspec.msgpack.decode(
        query.payload.to_bytes() if query.payload else b"", type=Request
    )
    print("the light is", "on" if request.on else "off")
    reply = msgspec.msgpack.encode({"success": True, "on": request.on})
    if call:
        answers[call.id] = reply
        if len(answers) > 1024:
            answers.pop(next(iter(answers)))  # the oldest
    return reply


def on_query(query: zenoh.Query) -> None:
    """Reply to a call, or refuse it with an error."""
    with query:
        try:
            query.reply(KEY, answer(query), encoding="application/msgpack")
        except (msgspec.DecodeError, TimeoutError, ValueError) as error:
            code = "expired" if isinstance(error, TimeoutError) else "invalid"
            refusal = msgspec.json.encode({"code": code, "message": f"own/light: {error}"})
            query.reply_err(refusal, encoding="application/json;quadctl.Error")


folder, realm = os.environ.get("XDG_RUNTIME_DIR"), os.environ.get("QUADCTL_REALM", "default")
base = f"{folder}/quadctl" if folder else f"/tmp/quadctl-{os.getuid()}"  # noqa: S108 - the hub's folder, which only this user can enter
retry = {"period_init_ms": 100, "period_max_ms": 100, "period_increase_factor": 1}
hub = {
    "endpoints": [f"unixsock-stream/{base}/{realm}/hub.sock"],
    "timeout_ms": 9000,
    "retry": retry,
}
config = {"mode": "client", "connect": hub, "scouting": {"multicast": {"enabled": False}}}
with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
    served = session.declare_queryable(KEY, on_query, complete=True)
    tokens = [session.liveliness().declare_token(token) for token in TOKENS]
    threading.Event().wait()  # until SIGTERM
