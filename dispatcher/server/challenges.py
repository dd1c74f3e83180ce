"""Challenges by which callers prove over a network that they have a token; each counts once."""

import secrets
from collections import Counter

from wire.dispatcher_service import NONCE_BYTES

MAX_CHALLENGES = 4096
MAX_OF_ONE = 64  # from one address, so that nobody crowds out another


class Challenges:
    """Those that were given out and not used; the oldest of an address give way."""

    def __init__(self) -> None:
        self._peers: dict[bytes, str] = {}  # by challenge, the oldest first
        self._of: Counter[str] = Counter()  # by address, without its port

    def give(self, peer: str) -> bytes:
        """Return a new one for a connection, as gRPC names its other end."""
        address = _address(peer)
        if self._of[address] >= MAX_OF_ONE:
            self._forget(next(n for n, known in self._peers.items() if _address(known) == address))
        elif len(self._peers) >= MAX_CHALLENGES:
            self._forget(next(iter(self._peers)))
        nonce = secrets.token_bytes(NONCE_BYTES)
        self._peers[nonce] = peer
        self._of[address] += 1
        return nonce

    def take(self, told: str | bytes | None, peer: str) -> bytes | None:
        """Return the one that is meant, which is used by that; None if it is not of this peer."""
        try:
            nonce = bytes.fromhex(told) if isinstance(told, str) else b""
        except ValueError:
            return None
        if self._peers.get(nonce) != peer:
            return None
        self._forget(nonce)
        return nonce

    def _forget(self, nonce: bytes) -> None:
        address = _address(self._peers.pop(nonce))
        self._of[address] -= 1
        if not self._of[address]:
            del self._of[address]


def _address(peer: str) -> str:
    return peer.rpartition(":")[0]
