"""Declarations in a client's Zenoh traffic, counted as it passes. Pure.

Zenoh 1.x, protocol version 9, without compression or shared memory: a stream of batches, each with
its length; in a batch transport and network messages, told apart by the lower five bits of their
headers. Only as much is read as is needed to find the next message. Source: zenoh-codec.
"""

from collections.abc import Callable
from typing import Any

_DECLARE, _INTEREST, _FRAGMENT, _INIT = 0x1E, 0x19, 0x06, 0x01
_FINAL = 0x1A
_KINDS = {0x00: "key", 0x02: "subscriber", 0x04: "queryable", 0x06: "token"}
"""Kinds of declarations; the number after each withdraws one."""
_QOS, _FIRST, _DROPPED = 0x31, 0x02, 0x03
"""Headers of a fragment's extensions."""
_KEY = 0x5F
"""Header of a withdrawal's extension: its key, where the number alone does not tell."""
_DATA = 5
"""Zenoh's default priority."""
_WILD = 8
"""Cost of a declaration with `**`: the router compares it with every key that it knows."""


class MalformedBatch(Exception):
    """Traffic that this module cannot read, so that nothing in it can be counted."""


class Declarations:
    """Subscribers, queryables, tokens, keys and interests that one end of a link has declared.

    `cost` is the sum of what is declared now: 1 for each, _WILD for one with `**`, 1 for a key.
    """

    def __init__(self, peer: "Declarations | None" = None) -> None:
        """Count for one end; `peer` counts for the other one, whose keys may be used as well."""
        self.cost = 0
        self.keys: dict[int, bytes] = {}
        """Declared keys by their number."""
        self._peer_keys = peer.keys if peer else {}
        self._costs: dict[tuple[str, int], dict[bytes, int]] = {}
        """Costs by kind, number and key: between routers all have the number 0."""
        self._is_router = False
        self._partial = b""
        self._fragments: dict[tuple[int, int], int] = {}
        """Number of the fragment that continues a message, by reliability and priority."""

    def feed(self, data: bytes) -> None:
        """Count the declarations in the next piece of the stream; raise MalformedBatch."""
        waiting = self._partial + data
        begin, size = 0, len(waiting)
        while size - begin >= 2:
            end = begin + 2 + (waiting[begin] | waiting[begin + 1] << 8)
            if end > size:
                break
            try:
                self._read(_Batch(waiting, begin + 2, end))
            except (IndexError, KeyError) as error:
                raise MalformedBatch(f"a batch of {end - begin - 2} bytes") from error
            begin = end
        self._partial = waiting[begin:]

    def _read(self, batch: "_Batch") -> None:
        while batch.at < batch.end:
            header = batch.byte()
            kind = header & 0x1F
            # A frame's messages follow it like messages of the batch.
            if kind == _DECLARE:
                self._declare(batch, header)
            elif kind == _INTEREST:
                self._interest(batch, header)
            elif kind == _FRAGMENT:
                self._fragment(batch, header)
            elif kind == _INIT:
                batch.byte()
                self._is_router = batch.byte() & 3 == 0
                batch.skip_all(header)
            else:
                _SKIPPED[kind](batch, header)
        if batch.at != batch.end:
            raise IndexError

    def _declare(self, batch: "_Batch", header: int) -> None:
        if header & 0x20:  # the answer to an interest
            batch.number()
        batch.extensions(header)
        header = batch.byte()
        kind = header & 0x1F
        if kind == _FINAL:
            batch.extensions(header)
            return
        number = batch.number()
        if kind in _KINDS:
            own = kind == 0 or bool(header & 0x40)
            self._add(_KINDS[kind], number, self._name(*batch.key(header & 0x20), own=own))
            batch.extensions(header)
            return
        named = batch.extensions(header).get(_KEY)
        self._remove(_KINDS[kind - 1], number, self._named(named) if named else b"")

    def _interest(self, batch: "_Batch", header: int) -> None:
        number = batch.number()
        if mode := header >> 5 & 3:
            options = batch.byte()
            key = batch.key(options & 0x20) if options & 0x10 else (0, b"**")
            if mode & 2:  # lasts
                self._add("interest", number, self._name(*key, own=bool(options & 0x40)))
        else:
            self.cost -= sum(self._costs.pop(("interest", number), {}).values())
        batch.extensions(header)

    def _name(self, scope: int, suffix: bytes, *, own: bool) -> bytes:
        if not scope:
            return suffix
        # Of a key that we do not know the worst is assumed.
        return (self.keys if own else self._peer_keys).get(scope, b"**%d" % scope) + suffix

    def _named(self, extension: bytes) -> bytes:
        """Return the name in the extension of a withdrawal."""
        batch = _Batch(extension, 0, len(extension))
        flags, scope = batch.byte(), batch.number()
        return self._name(scope, extension[batch.at :], own=bool(flags & 2))

    def _add(self, kind: str, number: int, name: bytes) -> None:
        costs = self._costs.setdefault((kind, number), {})
        if kind == "key":
            self.keys[number] = name
        cost = _WILD if b"**" in name and kind != "key" else 1
        self.cost += cost - costs.pop(name, 0)
        costs[name] = cost

    def _remove(self, kind: str, number: int, name: bytes) -> None:
        """Forget a declaration: the named one, else a client's last of that number."""
        costs = self._costs.get((kind, number), {})
        if name:
            self.cost -= costs.pop(name, 0)
        elif costs and not self._is_router:
            self.cost -= costs.popitem()[1]
        if not costs:
            self._costs.pop((kind, number), None)

    def _fragment(self, batch: "_Batch", header: int) -> None:
        """Read a piece of a message that is longer than a batch."""
        number, found = batch.number(), batch.extensions(header)
        channel = header & 0x20, found.get(_QOS, _DATA) & 0x7
        continues = self._fragments.pop(channel, -1) == number and _FIRST not in found
        # No declaration is that long: 64 kB.
        if not continues and batch.byte() & 0x1F in {_DECLARE, _INTEREST}:
            raise KeyError("a declaration in fragments")
        if header & 0x40 and _DROPPED not in found:
            self._fragments[channel] = number + 1
        batch.at = batch.end


class _Batch:
    """Reader of a batch; any read beyond its end raises IndexError."""

    def __init__(self, data: bytes, begin: int, end: int) -> None:
        self._data, self.at, self.end = data, begin, end

    def byte(self) -> int:
        at = self.at
        if at >= self.end:
            raise IndexError
        self.at = at + 1
        return self._data[at]

    def number(self) -> int:
        """Read an integer of variable length: 7 bits a byte, the lowest first, at most 9 bytes."""
        value = shift = 0
        while shift < 56:
            byte = self.byte()
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
            shift += 7
        return value | self.byte() << 56

    def block(self) -> bytes:
        """Read bytes that follow their length."""
        length = self.number()
        begin, self.at = self.at, self.at + length
        if self.at > self.end:
            raise IndexError
        return self._data[begin : self.at]

    def key(self, named: int) -> tuple[int, bytes]:
        """Read a key expression: the number of a declared key, and what is appended to it."""
        return self.number(), self.block() if named else b""

    def content(self, header: int) -> Any:
        """Read what an extension's header announces: nothing, a number or bytes."""
        match header & 0x60:
            case 0x20:
                return self.number()
            case 0x40:
                return self.block()
            case 0x60:
                raise KeyError(header)
        return None

    def extensions(self, header: int) -> dict[int, Any]:
        """Read the extensions, if the message's header announces any; return them by header."""
        found = {}
        more = header & 0x80
        while more:
            extension = self.byte()
            found[extension & 0x7F] = self.content(extension)
            more = extension & 0x80
        return found

    def skip_push(self, header: int) -> None:
        self.key(header & 0x20)
        self.extensions(header)
        self._put_or_delete()

    def skip_request(self, header: int) -> None:
        self.number()
        self.key(header & 0x20)
        self.extensions(header)
        header = self.byte()
        if header & 0x1F != 0x03:
            raise KeyError(header)
        if header & 0x20:  # consolidation
            self.number()
        if header & 0x40:  # parameters
            self.block()
        self.extensions(header)

    def skip_response(self, header: int) -> None:
        self.number()
        self.key(header & 0x20)
        self.extensions(header)
        header = self.byte()
        if header & 0x1F == 0x05:  # an error
            if header & 0x40:
                self._encoding()
            self._payload(header)
            return
        if header & 0x1F != 0x04:
            raise KeyError(header)
        if header & 0x20:  # consolidation
            self.number()
        self.extensions(header)
        self._put_or_delete()

    def skip_numbered(self, header: int) -> None:
        """Skip the head of a frame, or the end of the responses to a request."""
        self.number()
        self.extensions(header)

    def skip_aside(self, header: int) -> None:
        """Skip a message out of band, as between routers."""
        self.number()
        self.extensions(header)
        self.content(header)

    def skip_all(self, _header: int) -> None:
        """Skip the rest: such a message is alone in its batch."""
        self.at = self.end

    def _put_or_delete(self) -> None:
        header = self.byte()
        if header & 0x20:  # a timestamp
            self.number()
            self.block()
        match header & 0x1F:
            case 0x01:
                if header & 0x40:
                    self._encoding()
                self._payload(header)
            case 0x02:
                self.extensions(header)
            case other:
                raise KeyError(other)

    def _encoding(self) -> None:
        if self.number() & 1:  # a schema
            self.block()

    def _payload(self, header: int) -> None:
        if any(extension & 0x0F == 0x02 for extension in self.extensions(header)):
            raise KeyError("shared memory")  # whose payload has another form
        self.block()


_SKIPPED: dict[int, Callable[[_Batch, int], object]] = {
    0x00: _Batch.skip_aside,
    0x02: _Batch.skip_all,
    0x03: _Batch.skip_all,
    0x04: _Batch.extensions,
    0x05: _Batch.skip_numbered,
    0x1A: _Batch.skip_numbered,
    0x1B: _Batch.skip_response,
    0x1C: _Batch.skip_request,
    0x1D: _Batch.skip_push,
    0x1F: _Batch.skip_aside,
}
"""Readers of all other messages: open, close, keep-alive and frame, end of responses,
response, request, push; and those out of band."""
