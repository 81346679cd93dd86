"""Parameters of another node, kept at the values that it has accepted."""

from collections.abc import Callable

from quadctl.schemas.messages import Called
from quadctl.schemas.params import Params
from quadctl.schemas.topics import called, set_params
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.params.live import adopt


def follow(
    node: Node, name: str, params: Params, changed: Callable[[], None], *, inline: bool = False
) -> None:
    """Take each change of another node's parameters, in place, and call `changed`.

    `inline` is that of `Node.listen`.
    """

    def take(call: Called) -> None:
        if not call.response.get("success"):
            return
        try:
            adopt(params, name, call.request.get("values"))
        except Invalid as error:
            node.log.warning("%s; %s", error.message, error.hint)
        else:
            changed()

    node.listen(called(set_params(name)), take, inline=inline)
