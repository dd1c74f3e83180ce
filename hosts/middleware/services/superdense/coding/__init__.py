"""Error-correction codes over bits, and the order in which their bits travel.

Pure functions on numpy arrays: no frame, no symbol, no light. Each code is a `Code`, found
in CODES by its number on the wire; `interleaving` spreads a codeword over many symbols.
"""

from hosts.middleware.services.superdense.coding.code import (
    Bits,
    Code,
    Mask,
    ReedSolomon,
    Uncoded,
    deinterleave,
    interleave,
)
from hosts.middleware.services.superdense.coding.perfect import GOLAY, HAMMING, REPETITION
from wire.metadata.vocabulary import FEC_NAMES, Fec

CODES: dict[Fec, Code] = {
    code.fec: code for code in (Uncoded(), REPETITION, HAMMING, GOLAY, ReedSolomon())
}
NAMES = FEC_NAMES

__all__ = ["CODES", "NAMES", "Bits", "Code", "Mask", "deinterleave", "interleave"]
