"""Callers: the token, and not the address, names the node, and the node says what it may do."""

import hmac
import secrets
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from hashlib import sha256

import grpc

from dispatcher.refusal import Refusal, denied, not_found
from wire.config import BadConfig
from wire.dispatcher_service import NONCE_BYTES, NONCE_KEY, PROOF_KEY, RUNNER, TOKEN_KEY, proof

PRIVATE = "unix:"  # how gRPC names the other end of the private socket
MAX_CHALLENGES = 4096
MAX_OF_ONE = 64  # from one address, so that nobody crowds out another


class Callers:
    def __init__(self, tokens: dict[str, str], switches: Collection[str]) -> None:
        """Know each node's token; nodes that are switches have a switch's rights."""
        empty = [node for node, token in tokens.items() if not token]
        if empty:
            raise BadConfig(f"the token of {empty[0]} is empty; give each node a random one")
        # Looking up the digest takes a time that says nothing about the tokens.
        self._nodes = {_digest(token): node for node, token in tokens.items()}
        self._tokens = tokens
        self._switches = switches
        self.challenges = Challenges()

    def of_call(
        self,
        metadata: Mapping[str, str | bytes],
        peer: str,
        method: str,
        certified: Iterable[bytes] | None = None,
    ) -> str:
        """Return the node that makes a call: by its token on the private socket, or by proof.

        Where it comes by TLS, its certificate must name that node, too.
        """
        if PROOF_KEY in metadata:
            node = self._proved(metadata, peer, method)
            if certified is not None and node.encode() not in certified:
                names = b", ".join(certified).decode(errors="replace")
                raise _unknown(f"the proof is {node}'s, and the certificate of {names}")
            return node
        if TOKEN_KEY in metadata and not peer.startswith(PRIVATE):
            raise _unknown("a token came over the network, where others may read it; prove it")
        return self.identify(metadata.get(TOKEN_KEY))

    def _proved(self, metadata: Mapping[str, str | bytes], peer: str, method: str) -> str:
        nonce = self.challenges.take(metadata.get(NONCE_KEY), peer)
        if nonce is None:
            raise _unknown("the challenge is not of this connection, or was used before")
        token_proof = str(metadata[PROOF_KEY]).encode()
        for node, token in self._tokens.items():
            if hmac.compare_digest(token_proof, proof(token, nonce, method).encode()):
                return node
        raise _unknown(f"no node's token proves {method} so")

    def identify(self, token: str | bytes | None) -> str:
        node = self._nodes.get(_digest(token)) if isinstance(token, str) else None
        if node is None:
            problem = "unknown token" if token else "no token"
            message = f"{problem} in the call's metadata; send the node's own as {TOKEN_KEY}"
            raise Refusal(grpc.StatusCode.UNAUTHENTICATED, message)
        return node

    def require_host(self, node: str) -> None:
        """Refuse all but hosts, which alone hold qubits."""
        if node == RUNNER or node in self._switches:
            raise denied(f"{node} is not a host; only hosts act on qubits")

    def require_runner(self, node: str, act: str) -> None:
        if node != RUNNER:
            raise denied(f"{node} may not {act}; only {RUNNER} may")

    def watched_by(self, node: str, requested: str) -> str:
        """Return which node's events a caller hears; only the runner hears those of others."""
        if node != RUNNER and requested not in ("", node):
            raise denied(f"{node} may not watch {requested}; only {RUNNER} may")
        return requested if node == RUNNER else node

    def require_agent(self, node: str, switch: str, act: str) -> None:
        self.require_known(switch)
        if node != switch:
            raise denied(f"{node} may not {act} {switch}; only its own agent may")

    def require_reader(self, node: str, switch: str) -> None:
        self.require_known(switch)
        if node not in (switch, RUNNER):
            raise denied(f"{node} may not read {switch}; only its own agent and {RUNNER} may")

    def require_known(self, switch: str) -> None:
        if switch not in self._switches:
            names = ", ".join(sorted(self._switches)) or "none"
            raise not_found(f"no quantum switch {switch}; there is {names}")


def _unknown(problem: str) -> Refusal:
    return Refusal(
        grpc.StatusCode.UNAUTHENTICATED,
        f"{problem} ({NONCE_KEY}, {PROOF_KEY}: wire.dispatcher_service)",
    )


def _digest(token: str) -> bytes:
    return sha256(token.encode()).digest()


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

    def take(self, nonce_text: str | bytes | None, peer: str) -> bytes | None:
        """Return the one that is meant, which is used by that; None if it is not of this peer."""
        try:
            nonce = bytes.fromhex(nonce_text) if isinstance(nonce_text, str) else b""
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
