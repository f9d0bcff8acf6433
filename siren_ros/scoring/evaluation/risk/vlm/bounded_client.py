"""HTTP clients with a deadline and a size limit for replies.

httpx limits the wait for each piece that comes, so that a server may send a byte now and then for ever.
"""

import asyncio
import ssl
from typing import Any, Final

import httpx

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.vlm.pipeline import MOST_REPLY_BYTES

_OF_THE_BODY: Final = frozenset({"content-encoding", "content-length", "transfer-encoding"})
"""Headers that describe how a body is transferred."""


class BoundedClients:
    """Makes clients for one address; each client serves one event loop."""

    def __init__(self, base_url: str, timeout_s: float) -> None:
        """Prepare for an address. ``timeout_s`` limits the time from a request's first byte to its reply's last byte.

        Raises:
            InputError: The address is none.
        """
        try:
            address = httpx.URL(base_url)
        except httpx.InvalidURL as error:
            raise InputError("base-url", base_url, f"such as http://localhost:8000/v1 ({error})") from error
        if address.scheme not in {"http", "https"} or not address.host:
            raise InputError("base-url", base_url, "such as http://localhost:8000/v1")
        self._timeout_s = timeout_s
        self._certificates = httpx.create_ssl_context()

    def client(self) -> httpx.AsyncClient:
        """Make a client; the caller closes it."""
        return _BoundedClient(self._timeout_s, self._certificates)


class _BoundedClient(httpx.AsyncClient):
    def __init__(self, timeout_s: float, certificates: ssl.SSLContext) -> None:
        # Compressed replies are not requested, because a few bytes could expand to gigabytes.
        headers = {"Accept-Encoding": "identity"}
        super().__init__(timeout=timeout_s, verify=certificates, headers=headers, follow_redirects=True)
        self._whole_s = timeout_s

    async def send(self, request: httpx.Request, *, stream: bool = False, **options: Any) -> httpx.Response:  # noqa: ARG002 - the body is small, and is always read
        """Send a request as httpx does, and read at most one byte more than the size limit.

        Raises:
            httpx.ReadTimeout: The reply is not whole in time.
        """
        try:
            async with asyncio.timeout(self._whole_s):
                response = await super().send(request, stream=True, **options)
                body = bytearray()
                async for piece in response.aiter_raw():
                    body += piece
                    if len(body) > MOST_REPLY_BYTES:
                        break
                await response.aclose()
        except TimeoutError as error:
            raise httpx.ReadTimeout(f"no whole reply within {self._whole_s:g} s", request=request) from error
        headers = [(name, value) for name, value in response.headers.multi_items() if name not in _OF_THE_BODY]
        whole = bytes(body[: MOST_REPLY_BYTES + 1])
        return httpx.Response(response.status_code, headers=headers, content=whole, request=response.request)
