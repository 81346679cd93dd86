"""`service call`."""

from typing import Annotated, Any

import msgspec

from cli import bus, output
from cli.declare import Arg, Opt
from cli.options import Options
from cli.service import lookup
from cli.values import is_type, message_of, table_of
from cli.which import about_service
from schemas.topics import STATE, Service
from services.runtime.bus.codec import plain
from services.runtime.errors import Refused, Unreachable, UsageError

_FORMS = {
    "msgpack": ("application/msgpack", msgspec.msgpack.encode),
    "json": ("application/json", msgspec.json.encode),
}


def call(
    options: Options,
    name: Annotated[str, Arg("A service.", complete="service")],
    arguments: Annotated[
        list[str] | None,
        Arg(
            "As zero=true, as JSON or 'zero: true', or as values in the fields' order.",
            complete="field",
        ),
    ] = None,
    form: Annotated[
        str, Opt("How to write to a service that is none of ours: msgpack or json.", ("--as",))
    ] = "msgpack",
) -> None:
    """Call a service and print its reply; one of your own by its name or key too.

    A type before the request, as ros2 service call has it, is understood and not needed.

    Example: quadctl service call toggle_cage cage_on=false
    """
    if form not in _FORMS:
        raise UsageError(f"--as {form}: no such form", f"it is {' or '.join(_FORMS)}")
    options = about_service(options, name)
    service = lookup.declared(name, options.vehicle)
    words = arguments or []
    reply = _ours(options, service, words) if service else _theirs(options, name, words, form)
    if options.json:
        output.document(reply)
    else:
        output.fields(reply)
    verdict = reply if isinstance(reply, dict) else {}
    if verdict.get("accepted") is False or verdict.get("success") is False:
        who = service.node if service else ""
        raise Refused(
            verdict.get("reason") or f"{name} said no",
            "`quadctl cage show` and `quadctl state` say more" if who == STATE.node else "",
        )


def _ours(options: Options, service: Service[Any, Any], words: list[str]) -> Any:
    words = _without_type(words, service.type_name)
    request = message_of(service.request, service.name, words)
    with bus.connect(options) as client:
        return msgspec.to_builtins(client.call(service, request))


def _theirs(options: Options, name: str, words: list[str], form: str) -> Any:
    encoding, encode = _FORMS[form]
    with lookup.connect(options, name) as client:
        key, type_ = lookup.key_of(client, name)
        words = _without_type(words, type_)
        payload = encode(table_of(words) if words else {})
        try:
            return plain(*client.ask(key, payload, encoding))
        except Unreachable as problem:
            hint = lookup.nearest_live(client, name) or problem.hint
            raise Unreachable(problem.message, hint) from problem


def _without_type(words: list[str], own: str) -> list[str]:
    # A request without fields may be no more than its type.
    return words[1:] if words and is_type(words[0], own) else words
