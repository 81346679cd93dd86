"""Declarations in a client's Zenoh traffic, counted as it passes. Pure.

No interceptor of Zenoh 1.10 counts. `access_control` permits each subscriber, queryable and token by
its key, and a user's own keys have no end; keys and interests in publishers' subscribers pass without
a rule. `downsampling`, `low_pass_filter` and `qos` read data and queries only. By 20 000 declarations
one client stopped all others for 7 to 18 s, and by one malformed key every new client for good. With
this module it took 42 ms (docs/explanation/security.md).

Zenoh's protocol 9 (1.x), without compression or shared memory: a stream of batches, each with
its length; in a batch transport and network messages, told apart by the lower five bits of their
headers. Only as much is read as is needed to find the next message. A message in which Zenoh
could find more declarations than we is refused. Source: zenoh-codec; rx.rs of zenoh-transport.
"""

import re
from collections.abc import Callable
from typing import Any

PROTOCOL = 9
"""Version of Zenoh's protocol, in the first message of each end."""
_DECLARE, _INTEREST, _FRAGMENT, _INIT = 0x1E, 0x19, 0x06, 0x01
_KEY, _FINAL = 0x00, 0x1A
_NAMED = {0x02, 0x04, 0x06}
"""Subscribers, queryables and tokens; as of a key, the kind after each withdraws one."""
_ROUTER, _CLIENT = 0, 2
_PATCH, _FIRST, _WITHDRAWN = 0x27, 0x02, 0x5F
"""Headers of extensions: an end's patch of the protocol, the mark of a message's first fragment,
and the key of a withdrawal, where the number alone does not tell."""
_RESPONDER, _SOURCE, _NEVER_SENT = 0x43, 0x41, {0x42, 0x47}
"""Extensions that Zenoh reads without regard to their length; the last ones are timestamps."""
_SHARED = {0x02, 0x04}
_CHUNK = rb"(\*\*?|(?!\$\*(/|$))([^/*$#?]|\$\*)+)"
_EXPRESSION = re.compile(
    rb"(?!.{1025}|.*(\*\*/\*|\$\*\$))%b(/%b){0,31}" % (_CHUNK, _CHUNK), re.DOTALL
)
"""Key expressions in canonical form, of at most 32 chunks and 1024 bytes. Zenoh stores any other as
well. Its router panics when it compares a malformed one with the next key, and then serves nobody new;
one of 10 000 chunks takes 140 MB, also in the hub, and a router may overflow its stack to forget it."""
_WILD = 16
"""Cost of a declaration with a wildcard. When declarations match one another, the time in which a
router forgets them grows with the third power of their number: 1000 took 3.3 s, 62 take 2 ms."""


class MalformedBatch(Exception):
    """Traffic that this module cannot read, so that nothing in it can be counted."""


class Declarations:
    """Subscribers, queryables, tokens, keys and interests that one end of a link has declared.

    `cost` is the sum of what is declared now: 1 for each, _WILD for one with a wildcard.
    """

    def __init__(self, peer: "Declarations | None" = None) -> None:
        """Count for a client; with `peer`, which counts for the other end, also for a router."""
        self.cost = 0
        self.keys: dict[int, bytes] = {}
        """Declared keys by their number."""
        self.asked: set[bytes] = set()
        """Wildcards of interests, also of past ones: a router keeps them until it ends."""
        self._peer = peer
        self._held: dict[tuple[int, int], dict[bytes, int]] = {}
        """Costs by kind, number and key: between routers all have the number 0."""
        self._mode: int | None = None
        self._marks = False
        """First fragments have a mark, as since Zenoh 1.1."""
        self._partial = b""

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
            if kind == _DECLARE:
                self._declare(batch, header)
            elif kind == _INTEREST:
                self._interest(batch, header)
            elif kind == _FRAGMENT:
                self._fragment(batch, header)
            elif kind == _INIT:
                self._init(batch, header)
            else:
                for part in _PARTS[kind]:
                    part(batch, header)
        if batch.at != batch.end:
            raise IndexError

    def _init(self, batch: "_Batch", header: int) -> None:
        """Read an end's first message, after which it sends no other such."""
        version, about = batch.byte(), batch.byte()
        if version != PROTOCOL:
            raise MalformedBatch(f"protocol {version} of Zenoh, not {PROTOCOL}")
        answers, mode = header & 0x20, about & 3
        if self._mode is not None or not (answers or self._peer or mode == _CLIENT):
            raise MalformedBatch("a second greeting, or that of a router")
        batch.skip((about >> 4) + 1)
        if header & 0x40:  # sizes
            batch.skip(3)
        batch.cookie(header ^ 0x20)
        self._mode, self._marks = mode, batch.extensions(header).get(_PATCH, 0) > 0

    def _declare(self, batch: "_Batch", header: int) -> None:
        if header & 0x20:  # the answer to an interest
            batch.number()
        batch.network(header)
        header = batch.byte()
        kind = header & 0x1F
        if kind == _FINAL:
            batch.extensions(header)
            return
        number = batch.number()
        if kind == _KEY or kind in _NAMED:
            own = kind != _KEY and bool(header & 0x40)
            self._add(kind, number, self._name(*batch.key(header & 0x20), own=own))
            batch.extensions(header)
        elif kind - 1 == _KEY or kind - 1 in _NAMED:
            named = batch.extensions(header).get(_WITHDRAWN)
            self._remove(kind - 1, number, self._withdrawn(named) if named else b"")
        else:
            raise KeyError(kind)

    def _interest(self, batch: "_Batch", header: int) -> None:
        number = batch.number()
        if mode := header >> 5 & 3:
            options = batch.byte()
            key = batch.key(options & 0x20) if options & 0x10 else (0, b"**")
            name = self._name(*key, own=bool(options & 0x40))
            if b"*" in name:
                self.asked.add(name)
            if mode & 2:  # lasts
                self._add(_INTEREST, number, name)
        else:
            self._remove(_INTEREST, number, b"")
        batch.network(header)

    def _name(self, scope: int, suffix: bytes, *, own: bool) -> bytes:
        keys = self.keys if own else self._peer.keys if self._peer else {}
        if scope and scope not in keys:
            return b"**"  # the worst is assumed
        name = keys[scope] + suffix if scope else suffix
        if not _EXPRESSION.fullmatch(name):
            raise MalformedBatch("no key expression, or a long one")
        return name

    def _withdrawn(self, extension: bytes) -> bytes:
        """Return the name in the extension of a withdrawal."""
        batch = _Batch(extension, 0, len(extension))
        flags, scope = batch.byte(), batch.number()
        suffix = extension[batch.at :] if flags & 1 else b""
        return self._name(scope, suffix, own=bool(flags & 2)) if scope or suffix else b""

    def _add(self, kind: int, number: int, name: bytes) -> None:
        costs = self._held.setdefault((kind, number), {})
        if kind == _KEY:
            self.keys.setdefault(number, name)  # Zenoh, too, ignores the second one
        elif costs and name not in costs and not self._has_one_number(kind):
            # Zenoh would keep the first one until its router ends, not only this link.
            raise MalformedBatch("one number for two declarations")
        cost = _WILD if b"*" in name else 1
        self.cost += cost - costs.get(name, 0)
        costs[name] = cost

    def _remove(self, kind: int, number: int, name: bytes) -> None:
        """Forget a declaration: a router's by its name, any other by its number."""
        if self._has_one_number(kind):
            self.cost -= self._held.get((kind, number), {}).pop(name, 0)
            return
        self.cost -= sum(self._held.pop((kind, number), {}).values())
        if kind == _KEY:
            self.keys.pop(number, None)

    def _has_one_number(self, kind: int) -> bool:
        """Return whether all declarations of a kind have the number 0."""
        return self._mode == _ROUTER and kind in _NAMED

    def _fragment(self, batch: "_Batch", header: int) -> None:
        """Read a piece of a message that is longer than a batch."""
        batch.number()
        is_first = _FIRST in batch.extensions(header)
        if not self._marks:
            raise MalformedBatch("a fragment as before Zenoh 1.1")
        # No declaration is that long: 64 kB.
        if is_first and batch.byte() & 0x1F in {_DECLARE, _INTEREST}:
            raise MalformedBatch("a declaration in fragments")
        batch.at = batch.end


class _Batch:
    """Reader of a batch; any read beyond its end raises IndexError.

    What a message may lack, its header tells.
    """

    def __init__(self, data: bytes, begin: int, end: int) -> None:
        self._data, self.at, self.end = data, begin, end

    def byte(self, _header: int = 0) -> int:
        at = self.at
        if at >= self.end:
            raise IndexError
        self.at = at + 1
        return self._data[at]

    def number(self, _header: int = 0) -> int:
        """Read an integer of variable length: 7 bits a byte, the lowest first, at most 9 bytes."""
        value = shift = 0
        while shift < 56:
            byte = self.byte()
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
            shift += 7
        return value | self.byte() << 56

    def skip(self, count: int) -> None:
        self.at += count
        if self.at > self.end:
            raise IndexError

    def block(self, _header: int = 0) -> bytes:
        """Read bytes that follow their length."""
        length = self.number()
        begin = self.at
        self.skip(length)
        return self._data[begin : self.at]

    def key(self, header: int) -> tuple[int, bytes]:
        """Read a key expression: the number of a declared key, and what is appended to it."""
        return self.number(), self.block() if header & 0x20 else b""

    def cookie(self, header: int) -> None:
        if not header & 0x20:
            self.block()

    def time(self, header: int) -> None:
        if header & 0x20:
            self.number()
            self.block()

    def encoding(self, header: int) -> None:
        if header & 0x40 and self.number() & 1:
            self.block()

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
        """Read the extensions of a message, and return them by header."""
        found: dict[int, Any] = {}
        more = header & 0x80
        while more:
            extension = self.byte()
            if extension & 0x7F in found:
                raise KeyError(extension)
            found[extension & 0x7F] = self.content(extension)
            more = extension & 0x80
        return found

    def network(self, header: int) -> None:
        """Read the extensions of a network message."""
        if header & 0x80:
            found = self.extensions(header)
            if found.keys() & _NEVER_SENT:
                raise KeyError(header)
            _check_length(found.get(_RESPONDER), 1)

    def data(self, header: int) -> None:
        """Read the extensions of data or a query."""
        if header & 0x80:
            found = self.extensions(header)
            if any(extension & 0x0F in _SHARED for extension in found):
                raise MalformedBatch("shared memory")  # whose payload has another form
            _check_length(found.get(_SOURCE), 2)


def _check_length(identity: bytes | None, numbers: int) -> None:
    """Raise KeyError for the extension of an identity whose length is not that of its content."""
    if identity is not None:
        batch = _Batch(identity, 0, len(identity))
        batch.skip((batch.byte() >> 4) + 1)
        for _ in range(numbers):
            batch.number()
        if batch.at != batch.end:
            raise KeyError(_RESPONDER)


_Part = Callable[[_Batch, int], object]


def _where(flag: int, part: _Part) -> _Part:
    return lambda batch, header: part(batch, header) if header & flag else None


def _body(kinds: dict[int, tuple[_Part, ...]]) -> _Part:
    """Return the reader of a message's inner part, which has a header of its own."""

    def read(batch: _Batch, _header: int) -> None:
        header = batch.byte()
        for part in kinds[header & 0x1F]:
            part(batch, header)

    return read


_B = _Batch
_DATA = _body(
    {
        0x01: (_B.time, _B.encoding, _B.data, _B.block),
        0x02: (_B.time, _B.data),
    }
)
_QUERY = _body({0x03: (_where(0x20, _B.number), _where(0x40, _B.block), _B.data)})
_REPLY = _body(
    {
        0x04: (_where(0x20, _B.number), _B.extensions, _DATA),
        0x05: (_B.encoding, _B.data, _B.block),
    }
)
_PARTS: dict[int, tuple[_Part, ...]] = {
    0x00: (_B.number, _B.network, _B.content),  # out of band
    0x02: (_B.number, _B.number, _B.cookie, _B.extensions),  # open
    0x03: (_B.byte, _B.extensions),  # close
    0x04: (_B.extensions,),  # keep-alive
    0x05: (_B.number, _B.network),  # the head of a frame, whose messages follow like the batch's
    0x1A: (_B.number, _B.network),  # the end of responses
    0x1B: (_B.number, _B.key, _B.network, _REPLY),
    0x1C: (_B.number, _B.key, _B.network, _QUERY),
    0x1D: (_B.key, _B.network, _DATA),  # push
    0x1F: (_B.number, _B.network, _B.content),  # out of band, as between routers
}
"""Parts of all other messages."""
