"""`service list`, `service info` and `service call`."""

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
_FORMS = {
    "msgpack": ("application/msgpack", msgspec.msgpack.encode),
    "json": ("application/json", msgspec.json.encode),
}


def list_(options: Options) -> None:
    """List the live services of all vehicles with their type and node.

    Example: quadctl service list
    """
    vehicles, live = context.listing(options, "@srv")
    if options.json:
        output.document([
            {"vehicle": s.vehicle, "name": s.name, "key": s.key, "type": s.type, "node": s.node}
            for s in live
        ])  # fmt: skip
        return
    rows = ((s.vehicle, s.name, s.type, s.node) for s in live)
    output.listing(vehicles, [("VEHICLE", "SERVICE", "TYPE", "NODE"), *rows])


def info(options: Options, name: Annotated[str, Arg("A service.", complete="service")]) -> None:
    """Show a service's node, key, type and fields; a service of your own has no fields here.

    Example: quadctl service info calibrate_pressure
    """
    options = about_service(options, name)
    known = _known(name, options.vehicle)
    with _connect(options, name) as client:
        live = _find_live(client, known.key(client.vehicle) if known else name)
        if live is None and known is None:
            raise _unknown(client, name)
        if live is None:
            assert known is not None  # noqa: S101 - checked above
            absent = Unreachable(
                f"no node serves {known.key(options.vehicle)} now",
                f"is {known.node} up? `quadctl status` shows it",
            )
            raise client.explained(absent, known.node)
    shown = {"name": live.name, "key": live.key, "type": live.type, "node": live.node}
    from quadctl.schemas.typeinfo import service_definition

    fields = service_definition(known.request, known.response) if known else ""
    if options.json:
        output.document(shown | {"hash": live.hash, "definition": fields})
        return
    about = (
        known.doc if known else "not a service of quadctl: the author of its node knows its fields"
    )
    rows = (("Node", live.node), ("Key", live.key), ("Type", live.type), ("About", about))
    output.table((f"{title}:", text) for title, text in rows)
    if fields:
        output.line(fields)


def call(
    options: Options,
    name: Annotated[str, Arg("A service.", complete="service")],
    arguments: Annotated[
        list[str] | None,
        Arg(
            "Fields: zero=true, JSON, 'zero: true', or only values in the fields' order.",
            complete="field",
        ),
    ] = None,
    form: Annotated[
        str, Option("Encoding for a service of your own: msgpack or json.", ("--as",))
    ] = "msgpack",
) -> None:
    """Call a service and print its reply; a service of your own by its name or key, too.

    A type before the request, as in ros2 service call, is accepted and not needed.

    Example: quadctl service call toggle_cage cage_on=false
    """
    if form not in _FORMS:
        raise UsageError(f"--as {form}: no such form", f"it is {' or '.join(_FORMS)}")
    options = about_service(options, name)
    service = _known(name, options.vehicle)
    words = arguments or []
    reply = _call_known(options, service, words) if service else _ask(options, name, words, form)
    if options.json:
        output.document(reply)
    else:
        output.fields(reply)
    verdict = reply if isinstance(reply, dict) else {}
    if verdict.get("accepted") is False or verdict.get("success") is False:
        reason = verdict.get("reason") or f"{name} refused"
        hint = "`quadctl cage show` and `quadctl state` show more"
        if reason.startswith("busy"):
            hint = "`replace=true` changes course"
        raise Refused(reason, hint if service and service.node == STATE.node else "")


def _call_known(options: Options, service: Service[Any, Any], words: list[str]) -> Any:
    words = _without_type(words, service.type_name)
    request = message_of(service.request, service.name, words)
    with context.connect(options) as client:
        return msgspec.to_builtins(client.call(service, request))


def _ask(options: Options, name: str, words: list[str], form: str) -> Any:
    encoding, encode = _FORMS[form]
    with _connect(options, name) as client:
        key, type_ = _key_of(client, name)
        words = _without_type(words, type_)
        payload = encode(table_of(words) if words else {})
        try:
            return to_jsonable(*client.call_raw(key, payload, encoding))
        except Unreachable as problem:
            hint = _nearest_live(client, name) or problem.hint
            raise Unreachable(problem.message, hint) from problem


def _without_type(words: list[str], own: str) -> list[str]:
    # A request without fields may be its type alone.
    return words[1:] if words and is_type(words[0], own) else words


def _known(name: str, vehicle: str) -> Service[Any, Any] | None:
    """Return quadctl's service of that name or key, or None."""
    try:
        return find_service(name, vehicle)
    except Invalid:
        return None


def _connect(options: Options, name: str) -> Client:
    """Connect to look for a service; without a hub, report an unknown name first."""
    try:
        return context.connect(options)
    except Unreachable:
        if f"/{_MARK}" not in name:
            find_service(name, options.vehicle)
        raise


def _find_live(client: Client, name: str) -> EndpointInfo | None:
    """Return the live service of that name or key, or None."""
    bare = name.strip("/")
    spellings = {bare, bare.removeprefix(_MARK)}
    live = client.endpoints("@srv")
    return next((s for s in live if s.key == bare or s.name in spellings), None)


def _key_of(client: Client, name: str) -> tuple[str, str]:
    """Return the key to call for a service of another author, and its announced type or "".

    A full key is taken unchanged, announced or not. Raises Invalid, with the nearest live name, for
    a name that no node has announced.
    """
    live = _find_live(client, name)
    if live is not None:
        return live.key, live.type
    bare = name.strip("/")
    if f"/{_MARK}" not in bare:
        raise _unknown(client, name)
    key = checked_key(bare, client.vehicle)
    if "*" in key:
        raise Invalid(
            f"{key} is a pattern, and services are not called by pattern",
            "`quadctl service list` shows the keys",
        )
    return key, ""


def _unknown(client: Client, name: str) -> Invalid:
    """Return the error for a service that does not exist, with the nearest one that does."""
    hint = _nearest_live(client, name) or "`quadctl service list` shows them all"
    return Invalid(f"there is no service {name}", hint)


def _nearest_live(client: Client, name: str) -> str:
    """Return a hint that names the nearest live service; empty without one, or for its own name."""
    if _find_live(client, name) is not None:
        return ""
    live = {endpoint.name for endpoint in client.endpoints("@srv")}
    bare = name.strip("/").removeprefix(f"{client.vehicle}/").removeprefix(_MARK)
    return nearest(bare, live | {service.name for service in SERVICES})
