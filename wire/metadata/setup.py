"""The set-up message, which asks for light, and the answer to whatever is asked.

The set-up message has a fixed size, so that the controller can write its verdict into it without
moving a byte.
"""

import struct
from dataclasses import dataclass, replace
from ipaddress import IPv4Address

from wire.malformed import MalformedPacket
from wire.metadata.header import HEADER, Message, member, parted
from wire.metadata.vocabulary import (
    PAPER_ENCODING,
    SYMBOLS,
    Fec,
    Handshake,
    MemoryState,
    Reason,
    Verdict,
    service_of,
)
from wire.outcomes import Pauli

SEAL_BYTES = 16
OBSTACLE_BYTES = 96


@dataclass(frozen=True)
class Setup(Message):
    """Ask for light paths. First on its connection, one write, nothing after until answered."""

    KIND = 1
    FIELDS = struct.Struct(f"!BB4sIIIHIBBBBBIiIIBI{OBSTACLE_BYTES}sBBH{SEAL_BYTES}s")

    service: int
    handshake: int
    # IPv4 address of the pair source, of the opener if it keeps half of each pair itself; of
    # another node if the reason says so.
    source: str
    pairs: int  # pairs in a block at most
    frame_bytes: int
    rate_hz: int
    port: int = 0  # the application's port, as in TCP
    # ONE_PAIR: number of the pair. SWAP: switches that the controller has swap; 0: none.
    block: int = 0
    encoding: int = PAPER_ENCODING  # proposed; the answer says which one is used
    fec: int = Fec.NONE  # error-correction code; a receiver refuses one that it does not know
    interleave: int = 0  # 1: the bits of its codewords travel far from each other
    polarization: int = 0  # 0 is the horizontal/vertical basis
    memory: int = MemoryState.ANY
    # wire.optical.ANY_WAVELENGTH: what the controller writes here with its verdict.
    wavelength_pm: int = 1_550_120
    phase_mrad: int = 0
    sync_window_ps: int = 1_000_000
    fidelity_ppm: int = 0  # pair fidelity wanted at least; 0 is any
    priority: int = 0  # among those that wait for light, if the policy heeds it: the higher first
    deadline_ms: int = 0  # of the network, until light is wanted at the latest; 0: no deadline
    # Which element is in the way, in the controller's words, with a refusal; ASCII, filled with 0.
    obstacle: str = ""
    verdict: int = Verdict.PENDING
    rotation: int = Pauli.I  # known rotation of the paths, for the receiver to undo
    reason: int = Reason.OK
    seal: bytes = bytes(SEAL_BYTES)  # of the controller, with its verdict (wire.verdict)

    def encode(self) -> bytes:
        packed = {"source": IPv4Address(self.source).packed, "obstacle": self.obstacle.encode()}
        _session, *fields = {**vars(self), **packed}.values()
        return self._frame(self.FIELDS.pack(*fields))

    @classmethod
    def parse(cls, session: int, body: bytes) -> "Setup":
        raw = super().parse(session, body)
        assert isinstance(raw, Setup)
        for name in ("pairs", "frame_bytes", "rate_hz"):
            if getattr(raw, name) == 0:
                raise MalformedPacket(f"{name} is 0")
        _check_encoding(raw.encoding)
        if raw.interleave > 1:
            raise MalformedPacket(f"interleave is {raw.interleave}, not 0 or 1")
        return replace(
            raw,
            service=service_of(raw.service),
            handshake=member(Handshake, raw.handshake),
            source=str(IPv4Address(raw.source)),
            obstacle=_words(raw.obstacle),
            verdict=member(Verdict, raw.verdict),
            rotation=member(Pauli, raw.rotation),
            reason=member(Reason, raw.reason),
        )


def _words(padded: object) -> str:
    assert isinstance(padded, bytes)
    text = padded.rstrip(b"\0")
    if not text.isascii() or not text.decode("ascii").isprintable():
        raise MalformedPacket(f"obstacle {text!r} is not printable ASCII")
    return text.decode("ascii")


SETUP_LENGTH = HEADER.size + Setup.FIELDS.size


def refused(setup: bytes, reason: Reason) -> bytes:
    *request, _verdict, _rotation, _reason, seal = Setup.FIELDS.unpack(setup[HEADER.size :])
    answer = Setup.FIELDS.pack(*request, Verdict.REFUSED, Pauli.I, reason, seal)
    return setup[: HEADER.size] + answer


@dataclass(frozen=True)
class Answer(Message):
    """Accept (reason OK) or refuse what was asked last, with a text a person can act on.

    A receiver that accepts a set-up says how many Bell states its analyser tells apart, and
    by which operators the sender shall send that many symbols: with 3, those that stay
    distinguishable behind the known rotation of the light path. The acceptor of a set-up reports at
    which wavelength its light was granted.
    """

    KIND = 2
    FIELDS = struct.Struct("!HBBI")

    reason: int
    text: str = ""
    symbols: int = 0  # 3 or 4; 0 in any other answer
    encoding: int = 0
    wavelength_pm: int = 0  # 0 in any other answer

    def encode(self) -> bytes:
        """Return the message as it goes onto the wire; a text over 1,000 bytes is cut."""
        text = self.text.encode()[:1000].decode(errors="ignore").encode()
        return self._frame(
            self.FIELDS.pack(self.reason, self.symbols, self.encoding, self.wavelength_pm) + text
        )

    @classmethod
    def parse(cls, session: int, body: bytes) -> "Answer":
        (reason, symbols, encoding, wavelength_pm), text = parted(cls, body)
        if symbols or encoding:
            _check_encoding(encoding)
            if symbols not in SYMBOLS:
                raise MalformedPacket(f"Answer: {symbols} symbols")
        try:
            return cls(
                session,
                reason=member(Reason, reason),
                text=text.decode(),
                symbols=symbols,
                encoding=encoding,
                wavelength_pm=wavelength_pm,
            )
        except UnicodeDecodeError as error:
            raise MalformedPacket(f"Answer: text is not UTF-8: {error}") from error


def _check_encoding(encoding: int) -> None:
    if {encoding >> shift & 3 for shift in (0, 2, 4, 6)} != {0, 1, 2, 3}:
        raise MalformedPacket(f"encoding {encoding:#x} does not use each operator once")
