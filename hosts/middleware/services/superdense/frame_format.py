"""The format of a frame: bytes to code bits to symbols, and back.

    bytes -> bits -> codewords -> interleaved -> symbols

The one place that knows how many pairs carry a frame.
"""

from dataclasses import dataclass

import numpy as np

from hosts.hardware.replies import Symbols
from hosts.middleware.services.superdense.alphabet import ALPHABETS, Alphabet
from hosts.middleware.services.superdense.coding import CODES, NAMES, Code, deinterleave, interleave
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import MAX_BLOCK_PAIRS, MAX_FRAME_BYTES
from wire import dibits
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Fec, Reason


@dataclass(frozen=True)
class FrameFormat:
    """Code, order of its bits and alphabet of a session."""

    code: Code = CODES[Fec.NONE]
    interleaved: bool = False
    alphabet: Alphabet = ALPHABETS[4]

    @property
    def fills_losses(self) -> bool:
        return self.code.fec != Fec.NONE

    @property
    def plain(self) -> bool:
        """Whether symbols are the bytes themselves, two bits each.

        Then those of frames in a row are those of their bytes in a row, and can be made at once.
        """
        return not self.fills_losses and not self.interleaved and self.alphabet is ALPHABETS[4]

    def pairs(self, size: int) -> int:
        """Return how many pairs carry a frame of size bytes."""
        return self.alphabet.pairs(self.code.encoded_bits(8 * size))

    def to_symbols(self, data: bytes) -> Symbols:
        """Return the symbols of a frame; shape (pairs(len(data)),)."""
        if self.plain:
            return dibits.unpack(data, dibits.PER_BYTE * len(data))
        bits = np.unpackbits(np.frombuffer(data, dtype=np.uint8))
        encoded = self.code.encode(bits)
        if self.interleaved:
            encoded = interleave(self.code, encoded, bits.size)
        return self.alphabet.to_symbols(encoded)

    def to_bytes(self, symbols: Symbols, size: int) -> bytes:
        """Return the most likely bytes of a frame; only its check tells if they are right."""
        if self.plain:
            return dibits.pack(symbols & dibits.LARGEST)
        count = self.code.encoded_bits(8 * size)
        bits, erased = self.alphabet.to_bits(symbols, count)
        if self.interleaved:
            bits = deinterleave(self.code, bits, 8 * size)
            erased = deinterleave(self.code, erased, 8 * size)
        return np.packbits(self.code.decode(bits, erased, 8 * size)).tobytes()


def agreed_format(setup: Setup, symbols: int) -> FrameFormat:
    """Return what a set-up asks for; raise SessionError for an unknown code or long frames."""
    if setup.fec not in CODES:
        raise SessionError(
            Reason.UNSUPPORTED,
            f"error-correction code {setup.fec} is not known; offered are "
            + ", ".join(f"{number:d} ({name})" for name, number in NAMES.items()),
        )
    used = FrameFormat(CODES[Fec(setup.fec)], bool(setup.interleave), ALPHABETS[symbols])
    if used.pairs(min(setup.frame_bytes, MAX_FRAME_BYTES)) > MAX_BLOCK_PAIRS:
        raise SessionError(
            Reason.UNSUPPORTED,
            f"a frame of {setup.frame_bytes} bytes with the code {used.code.name} and {symbols} "
            f"symbols needs {used.pairs(setup.frame_bytes)} pairs, at most {MAX_BLOCK_PAIRS}; "
            "choose fewer bytes (--frame-bytes)",
        )
    return used
