"""`service call`."""

from typing import Annotated, Any

import msgspec

from quadctl.cli import context, output
from quadctl.cli.context import Options, about_service
from quadctl.cli.declarations import Arg, Option
from quadctl.cli.names import checked_key, find_service
from quadctl.cli.values import is_type, message_of, table_of
from quadctl.schemas.keyexpr import EndpointInfo
from quadctl.schemas.topics import SERVICES, STATE, Service
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.bus.codec import to_jsonable
from quadctl.services.runtime.errors import Invalid, Refused, Unreachable, UsageError
from quadctl.services.runtime.params.names import nearest

_MARK = "@srv/"


def declared(name: str, vehicle: str) -> Service[Any, Any] | None:
    """One of ours by name or key; None where it may be somebody else's."""
    try:
        return find_service(name, vehicle)
    except Invalid:
        return None


def connect(options: Options, name: str) -> Client:
    """Connect to look for a service; with no hub, a name that nobody knows is the worse fault."""
    try:
        return context.connect(options)
    except Unreachable:
        if f"/{_MARK}" not in name:
            find_service(name, options.vehicle)
        raise


def offered(client: Client, name: str) -> EndpointInfo | None:
    """A live service by name or key."""
    bare = name.strip("/")
    spellings = {bare, bare.removeprefix(_MARK)}
    return next((o for o in services(client) if o.key == bare or o.name in spellings), None)


def key_of(client: Client, name: str) -> tuple[str, str]:
    """The key to call by a name that is none of ours, and the type that is announced, or none.

    A full key is taken as it is, announced or not. Raises Invalid, with the nearest live name,
    for a name that nobody has announced.
    """
    offer = offered(client, name)
    if offer is not None:
        return offer.key, offer.type
    bare = name.strip("/")
    if f"/{_MARK}" not in bare:
        raise unknown(client, name)
    key = checked_key(bare, client.vehicle)
    if "*" in key:
        raise Invalid(
            f"{key} is a pattern, and services are not called by pattern",
            "`quadctl service list` shows the keys",
        )
    return key, ""


def services(client: Client) -> list[EndpointInfo]:
    """The live services."""
    return [offer for offer in client.endpoints() if offer.kind == "@srv"]


def unknown(client: Client, name: str) -> Invalid:
    """The error of who names a service that there is not, with the nearest that there is."""
    hint = nearest_live(client, name) or "`quadctl service list` shows them all"
    return Invalid(f"there is no service {name}", hint)


def nearest_live(client: Client, name: str) -> str:
    """A hint at the service that may be meant; empty where there is none, or it is that name."""
    if offered(client, name) is not None:
        return ""
    live = {offer.name for offer in services(client)}
    bare = name.strip("/").removeprefix(f"{client.vehicle}/").removeprefix(_MARK)
    return nearest(bare, live | {service.name for service in SERVICES})


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
        str, Option("How to write to a service that is none of ours: msgpack or json.", ("--as",))
    ] = "msgpack",
) -> None:
    """Call a service and print its reply; one of your own by its name or key too.

    A type before the request, as ros2 service call has it, is understood and not needed.

    Example: quadctl service call toggle_cage cage_on=false
    """
    if form not in _FORMS:
        raise UsageError(f"--as {form}: no such form", f"it is {' or '.join(_FORMS)}")
    options = about_service(options, name)
    service = declared(name, options.vehicle)
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
    with context.connect(options) as client:
        return msgspec.to_builtins(client.call(service, request))


def _theirs(options: Options, name: str, words: list[str], form: str) -> Any:
    encoding, encode = _FORMS[form]
    with connect(options, name) as client:
        key, type_ = key_of(client, name)
        words = _without_type(words, type_)
        payload = encode(table_of(words) if words else {})
        try:
            return to_jsonable(*client.ask(key, payload, encoding))
        except Unreachable as problem:
            hint = nearest_live(client, name) or problem.hint
            raise Unreachable(problem.message, hint) from problem


def _without_type(words: list[str], own: str) -> list[str]:
    # A request without fields may be no more than its type.
    return words[1:] if words and is_type(words[0], own) else words
