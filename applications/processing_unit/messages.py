"""Messages between an application and its processing unit, as NetQASM's SDK lays them out.

application                              unit
INIT, OPEN_SOCKET, STOP, SIGNAL ->
                                     <-  DONE
SUBROUTINE                      ->
                                     <-  RETURN_ARRAY, RETURN_REGISTER …, then DONE

The layouts are those of C structures on a machine of today: little-endian, aligned.
"""

import struct
from collections.abc import Sequence
from typing import NamedTuple

from applications.processing_unit.subroutine import (
    Subroutine,
    decode_register,
    decode_subroutine,
    encode_register,
    encode_subroutine,
)
from wire.malformed import MalformedPacket

INIT, OPEN_SOCKET, SUBROUTINE, STOP, SIGNAL = range(5)
DONE, _ERROR, RETURN_ARRAY, RETURN_REGISTER = range(4)
INITIAL = struct.Struct("<B3xIB3x")
SOCKET = struct.Struct("<B3xIiiiB3x")
STOPPING = struct.Struct("<B3xI")
SIGNALLING = struct.Struct("<BB")
FINISHED = struct.Struct("<B3xI")
ARRAY = struct.Struct("<Bii")
ENTRY = struct.Struct("<B3xi")
REGISTER = struct.Struct("<BB2xi")
MAX_ENTRIES = 65_536
ANY_FIDELITY = 100  # what the SDK says where nobody asks for one


class InitApplication(NamedTuple):
    """An application begins, with a maximum number of qubits."""

    application: int
    qubits: int


class OpenSocket(NamedTuple):
    """An application may share pairs with one at another node, each at a socket of its own."""

    application: int
    socket: int
    remote_node: int
    remote_socket: int


class StopApplication(NamedTuple):
    application: int


class StopUnit(NamedTuple):
    """The SDK's end of every connection; for a unit that others use, nothing."""


HostMessage = InitApplication | OpenSocket | Subroutine | StopApplication | StopUnit


class ReturnedArray(NamedTuple):
    """The contents of an array; None: not defined."""

    address: int
    values: list[int | None]


class ReturnedRegister(NamedTuple):
    register: int
    value: int


class Finished(NamedTuple):
    """A message of the application has been dealt with; the messages are counted from 0."""

    message: int


UnitMessage = ReturnedArray | ReturnedRegister | Finished


def decode_host_message(data: bytes) -> HostMessage:
    """Return what an application says; raise MalformedPacket if it is not of NetQASM."""
    kind = data[0] if data else None
    if kind == SUBROUTINE:
        return decode_subroutine(data[1:])
    if kind == INIT:
        return InitApplication(*_fields(INITIAL, data))
    if kind == OPEN_SOCKET:
        return OpenSocket(*_fields(SOCKET, data)[:4])
    if kind == STOP:
        return StopApplication(*_fields(STOPPING, data))
    if kind == SIGNAL and not any(_fields(SIGNALLING, data)):
        return StopUnit()
    raise MalformedPacket(f"no message of NetQASM to a processing unit: {data[:8].hex()}")


def encode_host_message(message: HostMessage) -> bytes:
    match message:
        case InitApplication(application, qubits):
            return INITIAL.pack(INIT, application, qubits)
        case OpenSocket(application, socket, node, remote_socket):
            return SOCKET.pack(OPEN_SOCKET, application, socket, node, remote_socket, ANY_FIDELITY)
        case Subroutine():
            return bytes([SUBROUTINE]) + encode_subroutine(message)
        case StopApplication(application):
            return STOPPING.pack(STOP, application)
        case StopUnit():
            return SIGNALLING.pack(SIGNAL, 0)


def encode_unit_message(message: UnitMessage) -> bytes:
    match message:
        case ReturnedArray(address, values):
            entries = (ENTRY.pack(value is not None, value or 0) for value in values)
            return ARRAY.pack(RETURN_ARRAY, address, len(values)) + b"".join(entries)
        case ReturnedRegister(register, value):
            return REGISTER.pack(RETURN_REGISTER, encode_register(register), value)
        case Finished(number):
            return FINISHED.pack(DONE, number)


def decode_unit_message(data: bytes) -> UnitMessage:
    """Return what a unit says; raise MalformedPacket if it is not of NetQASM."""
    kind = data[0] if data else None
    if kind == RETURN_ARRAY:
        return _array(data)
    if kind == RETURN_REGISTER:
        register, value = _fields(REGISTER, data)
        return ReturnedRegister(decode_register(register), value)
    if kind == DONE:
        return Finished(*_fields(FINISHED, data))
    raise MalformedPacket(f"no message of NetQASM to an application: {data[:8].hex()}")


def _array(data: bytes) -> ReturnedArray:
    if len(data) < ARRAY.size:
        raise MalformedPacket(f"an array in {len(data)} bytes")
    _kind, address, length = ARRAY.unpack_from(data)
    entries = data[ARRAY.size :]
    if not 0 <= length <= MAX_ENTRIES or len(entries) != length * ENTRY.size:
        raise MalformedPacket(f"an array of {length} entries in {len(entries)} bytes")
    return ReturnedArray(address, [_entry(*entry) for entry in ENTRY.iter_unpack(entries)])


def _entry(defined: int, value: int) -> int | None:
    if defined > 1:
        raise MalformedPacket(f"an entry of an array is of kind {defined}")
    return value if defined else None


def _fields(layout: struct.Struct, data: bytes) -> Sequence[int]:
    if len(data) != layout.size:
        raise MalformedPacket(f"message {data[0]} of {len(data)} bytes, not {layout.size}")
    return layout.unpack(data)[1:]
