"""Admits requests to the page's own address with its token, and no others."""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

COOKIE = "mammosim"
HOSTS = ("127.0.0.1", "localhost")
"""Names of this machine that a request may use: any other may come from another site (DNS
rebinding)."""


class Gate:
    """ASGI middleware for pages and web sockets alike.

    Parameters
    ----------
    app : ASGI application
    token : str
        In the address at first, then in a cookie of the browser.
    """

    def __init__(self, app: App, token: str) -> None:
        self.app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {name.lower(): value for name, value in scope.get("headers", ())}
        host = headers.get(b"host", b"").decode("latin-1").rpartition(":")[0]
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        by_address = hmac.compare_digest(given.encode(), self._token.encode())
        if host not in HOSTS or not (by_address or self._has_cookie(headers)):
            await self._refuse(scope, send)
            return

        async def with_cookie(message: Message) -> None:
            if by_address and message["type"] == "http.response.start":
                cookie = f"{COOKIE}={self._token}; HttpOnly; SameSite=Strict; Path=/"
                message["headers"] = [*message.get("headers", ()), (b"set-cookie", cookie.encode())]
            await send(message)

        await self.app(scope, receive, with_cookie)

    def _has_cookie(self, headers: MutableMapping[bytes, bytes]) -> bool:
        cookies: SimpleCookie = SimpleCookie()
        try:
            cookies.load(headers.get(b"cookie", b"").decode("latin-1"))
        except CookieError:
            return False
        kept = cookies.get(COOKIE)
        return kept is not None and hmac.compare_digest(kept.value.encode(), self._token.encode())

    async def _refuse(self, scope: Scope, send: Send) -> None:
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
            return
        text = b"This page needs the whole address that mammosim serve printed, with its token.\n"
        headers = [(b"content-type", b"text/plain; charset=utf-8")]
        await send({"type": "http.response.start", "status": 403, "headers": headers})
        await send({"type": "http.response.body", "body": text})
