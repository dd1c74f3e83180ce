"""The parts of the dispatcher's service beside its messages: limits, tokens, sockets."""

import hmac
import struct
from asyncio import StreamReader
from collections.abc import Iterable

from wire.malformed import MalformedPacket
from wire.network_time import NetworkTime, SteppedTime

LENGTH = struct.Struct("!I")
MAX_LENGTH = 1 << 20


def encode(message: bytes) -> bytes:
    return LENGTH.pack(len(message)) + message


async def read(stream: StreamReader) -> bytes:
    """Return the next message.

    Raise EOFError where the stream ends, MalformedPacket for more than MAX_LENGTH bytes.
    """
    (length,) = LENGTH.unpack(await stream.readexactly(LENGTH.size))
    if length > MAX_LENGTH:
        raise MalformedPacket(f"a message of {length} bytes, more than {MAX_LENGTH}")
    return await stream.readexactly(length)


TOKEN_KEY = "qmn-token"  # noqa: S105 - the name of the metadata entry
NONCE_KEY, PROOF_KEY = "qmn-nonce", "qmn-proof"  # of a call over a network
SLOT_KEY = "qmn-time-slot"  # of the caller, where time is stepped
NONCE_BYTES = 16
RUNNER = "runner"  # the node that the runner is
MAX_MESSAGE_BYTES = 16 << 20  # of either side: 4 bytes for each photon of the largest block
MESSAGE_LIMITS = [
    ("grpc.max_receive_message_length", MAX_MESSAGE_BYTES),
    ("grpc.max_send_message_length", MAX_MESSAGE_BYTES),
]
# Without its probes of bandwidth and delay: a PING and its answer for almost each message.
FLOW_CONTROL = [("grpc.http2.bdp_probe", 0), ("grpc.http2.lookahead_bytes", MAX_MESSAGE_BYTES)]
# A proxy that the environment names is of no use inside the network.
CHANNEL_OPTIONS = [*MESSAGE_LIMITS, *FLOW_CONTROL, ("grpc.enable_http_proxy", 0)]


def metadata(token: str) -> tuple[tuple[str, str]]:
    return ((TOKEN_KEY, token),)


def proof(token: str, nonce: bytes, method: str) -> str:
    """Return what shows that a caller of a method has a token: an HMAC-SHA256 over a challenge."""
    return hmac.digest(token.encode(), b"call" + nonce + method.encode(), "sha256").hex()


def proving(token: str, nonce: bytes, method: str) -> tuple[tuple[str, str], ...]:
    return (NONCE_KEY, nonce.hex()), (PROOF_KEY, proof(token, nonce, method))


def slot_of(time: NetworkTime) -> tuple[tuple[str, str], ...]:
    """Return the metadata of a call whose messages stepped time waits for."""
    return ((SLOT_KEY, str(time.slot)),) if isinstance(time, SteppedTime) else ()


def slot(metadata: Iterable[tuple[str, str | bytes]] | None) -> int:
    return int(dict(metadata or ()).get(SLOT_KEY, 0))


def cross_connects_socket(dispatcher: str) -> str:
    return f"{dispatcher}-paths"
