"""Who may ask the explorer's server, and how much at a time."""

from __future__ import annotations

import ipaddress
from collections.abc import Iterable
from urllib.parse import urlsplit

from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOCAL_HOSTS = ("127.0.0.1", "localhost", "::1")
EVERY_ADDRESS = ("0.0.0.0", "::", "")  # noqa: S104 - what `--host` may say, not what we bind to by ourselves
MAX_BODY_BYTES = 4_000_000
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
)


def is_welcome(headers: Iterable[tuple[bytes, bytes]], hosts: Iterable[str], addresses: bool = False) -> bool:
    """Tell whether a request names one of our `hosts` and comes from a page of ours, or from no page at all.

    A foreign Host is a name that somebody pointed at this machine (DNS rebinding); a number is no name, so with
    `addresses` any is taken. A foreign Origin, or a request that the browser says another site has made, is another
    site's page asking here; only a link that the user follows may come from one.
    """
    values = {key.decode("latin-1").lower(): value.decode("latin-1") for key, value in headers}
    host, origin = values.get("host", ""), values.get("origin")
    try:
        name = "" if "@" in host else urlsplit(f"//{host}").hostname or ""
        ours = name in hosts or (addresses and _is_address(name))
        if not ours or (origin is not None and urlsplit(origin).netloc.lower() != host.lower()):
            return False
    except ValueError:
        return False
    followed = values.get("sec-fetch-mode") == "navigate" and values.get("sec-fetch-dest") == "document"
    return values.get("sec-fetch-site", "none") in ("none", "same-origin") or (followed and origin is None)


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


class Gate:
    """ASGI middleware: 403 for what `is_welcome` refuses, 413 for too large a body, our headers on every answer."""

    def __init__(self, app: ASGIApp, host: str = LOCAL_HOSTS[0], allowed: tuple[str, ...] = ()) -> None:
        self._app, self._addresses = app, host in EVERY_ADDRESS
        self._hosts = frozenset(name.lower() for name in (*LOCAL_HOSTS, *allowed, host) if name not in EVERY_ADDRESS)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or hand on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":  # the page opens none
            await send({"type": "websocket.close", "code": 1008})
        elif not is_welcome(scope["headers"], self._hosts, self._addresses):
            await _refuse(send, 403, b"This page answers only to its own host and its own pages.")
        else:
            await self._answer(scope, receive, send)

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        told = dict(scope["headers"]).get(b"content-length", b"0")
        if not told.isdigit() or int(told) > MAX_BODY_BYTES:
            await _refuse(send, 413, TOO_LARGE)
            return
        n_bytes, begun = 0, False

        async def counted() -> Message:
            nonlocal n_bytes
            message = await receive()
            n_bytes += len(message.get("body", b""))
            return message if n_bytes <= MAX_BODY_BYTES else {"type": "http.disconnect"}

        async def headed(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                message = {**message, "headers": [*message.get("headers", ()), *HEADERS]}
            if begun or n_bytes <= MAX_BODY_BYTES:
                begun = True
                await send(message)

        try:
            await self._app(scope, counted, headed)
        except Exception:
            if n_bytes <= MAX_BODY_BYTES:  # else the application was told that the client is gone
                raise
        if n_bytes > MAX_BODY_BYTES and not begun:
            await _refuse(send, 413, TOO_LARGE)


TOO_LARGE = b"A request may have %d bytes." % MAX_BODY_BYTES


async def _refuse(send: Send, status: int, reason: bytes) -> None:
    headers = [(b"content-type", b"text/plain"), (b"connection", b"close"), *HEADERS]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": reason})
