"""Parameters of the hub."""

from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from schemas.endpoint import LOCAL, PORTS, SECURE


class HubParams(Struct, forbid_unknown_fields=True):
    """The Zenoh router that everything else is a client of."""

    transport: Annotated[
        Literal["auto", "unix", "tcp"],
        Meta(
            description="unix: a socket in the realm's folder; tcp: a loopback port with a password;"
            " auto: unix where there is such a thing",
            extra={"unit": ""},
        ),
    ] = "auto"
    listen: Annotated[
        list[str],
        Meta(
            description="further Zenoh endpoints to listen on, such as tcp/127.0.0.1:7447",
            extra={"unit": ""},
        ),
    ] = field(default_factory=list)
    connect: Annotated[
        list[str],
        Meta(
            description="other hubs to join, by their endpoints, such as tls/field.local:7447",
            extra={"unit": ""},
        ),
    ] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Raises ValueError for what no Zenoh router can listen on, or connect to."""
        if self.transport == "tcp" and any(
            endpoint.partition("/")[0] in SECURE for endpoint in (*self.listen, *self.connect)
        ):
            raise ValueError(
                "tls and quic need transport unix: they have certificates, no password"
            )
        for name, endpoints in (("listen", self.listen), ("connect", self.connect)):
            for endpoint in endpoints:
                _check_endpoint(name, endpoint)


def _check_endpoint(name: str, endpoint: str) -> None:
    protocol, _, address = endpoint.partition("/")
    if not (address and (protocol in LOCAL or (protocol in PORTS and ":" in address))):
        known = ", ".join((*PORTS, *LOCAL))
        raise ValueError(
            f"{name}: '{endpoint}' is no Zenoh endpoint, which is protocol/address such as "
            f"tcp/127.0.0.1:7447; the protocols are {known}"
        )
