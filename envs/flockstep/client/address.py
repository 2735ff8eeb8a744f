"""Addresses of servers."""

from __future__ import annotations

import ssl
from dataclasses import dataclass
from os import PathLike, fspath
from urllib.parse import urlsplit

DEFAULT_PORT = 41451
_EXPECTED = "'HOST:PORT', 'ws://HOST:PORT', 'wss://HOST:PORT' or 'unix:PATH'"


@dataclass(frozen=True)
class Address:
    """A server's address, and how to trust it. ``path`` is that of a Unix socket, or empty."""

    text: str
    uri: str
    host: str
    port: int
    path: str
    tls: ssl.SSLContext | None
    server_name: str | None  # that the certificate must have

    def advice(self) -> str:
        """Return what to do if no server is at this address."""
        return f"no server at {self.text}: start one with `python -m flockstep serve RECIPE`"


def parse_address(address: str, ca_file: str | PathLike[str] | None, check_hostname: bool) -> Address:
    """Return an address from its text.

    Raises
    ------
    ValueError
        The text is not an address, or ``ca_file`` is given but the address does not begin with ``wss://``.
    OSError
        ``ca_file`` cannot be read.
    """
    if not isinstance(address, str):
        raise TypeError(f"address: expected {_EXPECTED}, got {address!r}")
    is_secure = address.startswith("wss://")
    if not is_secure and (ca_file is not None or not check_hostname):
        option = "ca_file" if ca_file is not None else "check_hostname"
        raise ValueError(f"{option}: expected an address that begins with wss://, got {address!r}")
    if address.startswith("unix:"):
        path = address.removeprefix("unix:")
        if not path:
            raise ValueError(f"address: expected {_EXPECTED}, got {address!r}")
        return Address(address, "ws://localhost/", "", 0, path, None, None)
    uri = address if "://" in address else f"ws://{address}"
    try:
        parts = urlsplit(uri)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise ValueError(f"address: expected {_EXPECTED}, got {address!r} ({error})") from None
    if parts.scheme not in ("ws", "wss") or not host or parts.query or parts.fragment or parts.username is not None:
        raise ValueError(f"address: expected {_EXPECTED}, got {address!r}")
    port = DEFAULT_PORT if port is None else port
    netloc = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
    tls = None
    if is_secure:
        tls = ssl.create_default_context(cafile=None if ca_file is None else fspath(ca_file))
        tls.check_hostname = check_hostname
    uri = f"{parts.scheme}://{netloc}{parts.path or '/'}"
    return Address(address if port == parts.port else netloc, uri, host, port, "", tls, host if tls else None)


def ended(address: Address, reason: str) -> str:
    """Return the message for a connection that has ended: for a reason of this client, or of the server."""
    return reason if reason.startswith("this client") else f"the server at {address.text} {reason}"
