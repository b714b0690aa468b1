"""Pages are built in turn: with many asked for at once, the first is there first and open tabs are not kept waiting."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from typing import Any

from creative_nao.explorer.security import Scope

AT_ONCE = 2
"""One page that waits for a second memory to be loaded shall not keep all others waiting."""


class InTurn:
    """ASGI middleware that lets few requests for pages in at a time, in the order in which they came.

    Building a page takes 0.1 s in which nothing else is answered. Pages let in together finish together, the first as
    late as the last, and their age is counted from when they were let in: of fifty on a busy machine, all came when
    they had outlived the minute that a page is kept for its socket. A page's turn ends when its answer begins, so a
    reader who takes the answer slowly keeps nobody waiting.

    Args:
        app: The application behind.
        paths: Where the pages are.
    """

    def __init__(self, app: Any, paths: tuple[str, ...]) -> None:
        self._app, self._paths = app, paths
        self._places = asyncio.Semaphore(AT_ONCE)

    async def __call__(self, scope: Scope, receive: Any, send: Any) -> None:
        """Hand a request on, a page's when its turn has come."""
        if scope["type"] != "http" or scope["path"] not in self._paths:
            await self._app(scope, receive, send)
            return
        async with AsyncExitStack() as turn:
            await turn.enter_async_context(self._places)

            async def answering(message: Any) -> None:
                await turn.aclose()  # at the first message; later there is nothing left to close
                await send(message)

            await self._app(scope, receive, answering)
