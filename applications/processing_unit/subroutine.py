"""NetQASM subroutines in their binary form (Dahlberg et al. 2022, arXiv:2111.09823).

    version, 2 bytes | application, 2 bytes | instructions of 7 bytes each

An instruction is its number in one byte, its operands, and zeros. All integers are little-endian.
The instructions are those of the Vanilla flavour, which the SDK writes by default.
"""

import struct
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from wire.malformed import MalformedPacket

METADATA = struct.Struct("<BBH")
LANGUAGE = 0, 10  # version of NetQASM that the SDK says it writes
INSTRUCTION_BYTES = 7
MAX_INSTRUCTIONS = 100_000
REGISTER_BANKS = "RCQM"
REGISTERS_IN_A_BANK = 16
# Operands: r register, i integer (also an address of an array), b byte.
FORMATS = {"r": "B", "i": "i", "b": "B"}
GATES = ("x", "y", "z", "h", "s", "k", "t")  # of one qubit, numbered from 20
INSTRUCTIONS: Mapping[int, tuple[str, str]] = MappingProxyType(
    {
        1: ("qalloc", "r"),
        2: ("init", "r"),
        3: ("array", "ri"),  # its length, its address
        4: ("set", "ri"),
        5: ("store", "rir"),  # a register into an entry: address, index
        6: ("load", "rir"),
        7: ("undef", "ir"),
        8: ("lea", "ri"),
        9: ("jmp", "i"),
        10: ("bez", "ri"),
        11: ("bnz", "ri"),
        12: ("beq", "rri"),
        13: ("bne", "rri"),
        14: ("blt", "rri"),
        15: ("bge", "rri"),
        16: ("add", "rrr"),  # the result comes first
        17: ("sub", "rrr"),
        18: ("addm", "rrrr"),
        19: ("subm", "rrrr"),
        200: ("mul", "rrr"),
        201: ("div", "rrr"),
        202: ("rem", "rrr"),
        **{20 + place: (name, "r") for place, name in enumerate(GATES)},
        27: ("rot_x", "rbb"),  # by n pi / 2^d
        28: ("rot_y", "rbb"),
        29: ("rot_z", "rbb"),
        30: ("cnot", "rr"),
        31: ("cphase", "rr"),
        51: ("mov", "rr"),
        52: ("swp", "rr"),
        32: ("meas", "rr"),  # a qubit, and where the outcome goes
        41: ("meas_basis", "rrbbbb"),  # rotations by n1, n2, n3, and their d, before it
        48: ("meas_basis_yzy", "rrbbbb"),
        49: ("meas_basis_zxz", "rrbbbb"),
        33: ("create_epr", "rrrrr"),
        34: ("recv_epr", "rrrr"),
        35: ("wait_all", "irr"),  # a slice: address, start, stop
        36: ("wait_any", "irr"),
        37: ("wait_single", "ir"),
        38: ("qfree", "r"),
        39: ("ret_reg", "r"),
        40: ("ret_arr", "i"),
        100: ("breakpoint", "bb"),
    }
)
LAYOUTS = {
    number: struct.Struct("<B" + "".join(FORMATS[kind] for kind in operands))
    for number, (_name, operands) in INSTRUCTIONS.items()
}


class Instruction(NamedTuple):
    """One instruction; registers are numbers of 0 to 63, bank by bank."""

    name: str
    operands: tuple[int, ...]

    def __str__(self) -> str:
        """Return it as in NetQASM's text, with addresses of arrays as plain numbers."""
        kinds = KINDS[self.name]
        texts = (
            register_name(operand) if kind == "r" else str(operand)
            for kind, operand in zip(kinds, self.operands, strict=True)
        )
        return " ".join((self.name, *texts))


KINDS = dict(INSTRUCTIONS.values())
NUMBERS = {name: number for number, (name, _kinds) in INSTRUCTIONS.items()}


class Subroutine(NamedTuple):
    application: int
    instructions: tuple[Instruction, ...]


def register_name(number: int) -> str:
    bank, index = divmod(number, REGISTERS_IN_A_BANK)
    return f"{REGISTER_BANKS[bank]}{index}"


def encode_subroutine(subroutine: Subroutine) -> bytes:
    encoded = map(_encode, subroutine.instructions)
    return METADATA.pack(*LANGUAGE, subroutine.application) + b"".join(encoded)


def _encode(instruction: Instruction) -> bytes:
    number, kinds = NUMBERS[instruction.name], KINDS[instruction.name]
    operands = (
        encode_register(operand) if kind == "r" else operand
        for kind, operand in zip(kinds, instruction.operands, strict=True)
    )
    return LAYOUTS[number].pack(number, *operands).ljust(INSTRUCTION_BYTES, b"\0")


def decode_subroutine(data: bytes) -> Subroutine:
    """Return a subroutine; raise MalformedPacket if anything in it is not NetQASM."""
    body = data[METADATA.size :]
    count, rest = divmod(len(body), INSTRUCTION_BYTES)
    if len(data) < METADATA.size or rest or count > MAX_INSTRUCTIONS:
        raise MalformedPacket(
            f"a subroutine of {len(data)} bytes: {METADATA.size}, and {INSTRUCTION_BYTES} for "
            f"each of at most {MAX_INSTRUCTIONS} instructions"
        )
    _major, _minor, application = METADATA.unpack_from(data)
    starts = range(0, len(body), INSTRUCTION_BYTES)
    return Subroutine(
        application, tuple(_decode(body[start : start + INSTRUCTION_BYTES]) for start in starts)
    )


def _decode(data: bytes) -> Instruction:
    number = data[0]
    if number not in INSTRUCTIONS:
        raise MalformedPacket(f"no instruction of NetQASM's Vanilla flavour has number {number}")
    (name, kinds), layout = INSTRUCTIONS[number], LAYOUTS[number]
    if any(data[layout.size :]):
        raise MalformedPacket(f"bytes behind the operands of {name}: {data.hex()}")
    _number, *operands = layout.unpack_from(data)
    return Instruction(
        name,
        tuple(
            decode_register(operand) if kind == "r" else operand
            for kind, operand in zip(kinds, operands, strict=True)
        ),
    )


def decode_register(byte: int) -> int:
    """Return the register that a byte names: its bank in two bits, its index in the next four."""
    if byte >> 6:
        raise MalformedPacket(f"no register is named by {byte:#04x}")
    return (byte & 3) * REGISTERS_IN_A_BANK + (byte >> 2)


def encode_register(number: int) -> int:
    bank, index = divmod(number, REGISTERS_IN_A_BANK)
    return index << 2 | bank
