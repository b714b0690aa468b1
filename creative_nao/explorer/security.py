"""Keeps strangers out: a page on this machine answers only to this machine."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from typing import Any
from urllib.parse import urlsplit

Scope = MutableMapping[str, Any]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

LOCAL_HOSTS = ("127.0.0.1", "localhost", "::1")


def is_welcome(headers: Iterable[tuple[bytes, bytes]], hosts: tuple[str, ...] = LOCAL_HOSTS) -> bool:
    """Tell whether a request names one of our hosts and comes from a page of ours, or from no page at all.

    A foreign Host is a name that somebody pointed at this machine (DNS rebinding); a foreign Origin is another site's
    page opening a socket here.
    """
    found = {key.decode("latin-1").lower(): value.decode("latin-1") for key, value in headers}
    host, origin = found.get("host", ""), found.get("origin")
    try:
        if urlsplit(f"//{host}").hostname not in hosts:
            return False
        return origin is None or urlsplit(origin).netloc == host
    except ValueError:
        return False


class LocalOnly:
    """ASGI middleware: 403 for what `is_welcome` refuses, for pages and sockets alike."""

    def __init__(self, app: Any, hosts: tuple[str, ...] = LOCAL_HOSTS) -> None:
        self._app, self._hosts = app, hosts

    async def __call__(self, scope: Scope, receive: Any, send: Send) -> None:
        """Answer, or hand on."""
        if scope["type"] not in ("http", "websocket") or is_welcome(scope["headers"], self._hosts):
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await send({"type": "http.response.start", "status": 403, "headers": [(b"content-type", b"text/plain")]})
            await send({"type": "http.response.body", "body": b"This page answers only to its own host."})
