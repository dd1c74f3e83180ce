"""The seal of a verdict: proof that the controller has written it, for this very connection.

The controller is the only one beside the receiving host to know that host's device key. Its HMAC
(SHA-256, cut to 16 bytes) covers the connection and the whole set-up message before the seal:
session, what was asked for, verdict, rotation and reason. It stands in the last field of the
message, which the host that asks leaves 0.

    "verdict" | opener's IPv4 4, port 2 | receiver's IPv4 4, port 2 | message without its seal
"""

import hmac
import struct
from socket import inet_aton

from wire.metadata.setup import SEAL_BYTES

SPEAKER = b"verdict"  # no datagram under the same key begins so: wire.device
_CONNECTION = struct.Struct("!4sH4sH")


Connection = tuple[str, int, str, int]  # opener's address and port, receiver's


def seal(setup: bytes, key: str, connection: Connection) -> bytes:
    """Return an encoded set-up message sealed for a connection; the key is hexadecimal."""
    body = setup[:-SEAL_BYTES]
    return body + _tag(body, key, connection)


def is_sealed(setup: bytes, key: str, connection: Connection) -> bool:
    body, tag = setup[:-SEAL_BYTES], setup[-SEAL_BYTES:]
    return hmac.compare_digest(tag, _tag(body, key, connection))


def _tag(body: bytes, key: str, connection: Connection) -> bytes:
    source, source_port, destination, port = connection
    ends = _CONNECTION.pack(inet_aton(source), source_port, inet_aton(destination), port)
    return hmac.digest(bytes.fromhex(key), SPEAKER + ends + body, "sha256")[:SEAL_BYTES]
