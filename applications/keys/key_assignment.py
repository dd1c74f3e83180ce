"""The message of a master's key manager to a slave's: which stored keys are which delivered key.

No key travels where both have stored the same: the delivered key is the beginning of the stored
keys in their order. A further slave elsewhere gets the same key masked: combined by XOR with
keys that its manager shares with the master's, a one-time pad.

{"master_SAE_ID": …, "slave_SAE_IDs": [...], "void": [ids of stored keys that nobody will get],
 "keys": [{"key_ID": …, "size": bits, "stored": [ids], "masked": base64, if it is}]}
"""

import base64
import json
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from applications.keys.key_delivery import (
    MAX_DEPTH,
    MAX_IDS,
    MAX_NAMES,
    decode_base64,
    decode_id,
    decode_name,
)
from wire.bounded_json import decode_json
from wire.malformed import MalformedPacket

ASSIGNMENT_PATH = "/qmn/assignments"
MAX_ASSIGNMENT = 1 << 20  # bytes
MAX_STORED = 1 << 13  # stored keys in one assignment
MAX_BITS = 1 << 14  # of one key


@dataclass(frozen=True)
class AssignedKey:
    """A key to deliver, and the stored keys that it is made of or masked by."""

    key_id: UUID
    size: int  # bits
    stored: tuple[UUID, ...]
    masked: bytes = b""  # the key XOR what is stored; empty: the key is what is stored


@dataclass(frozen=True)
class Assignment:
    """Keys of one master for one or more slaves at one manager."""

    master: str
    slaves: tuple[str, ...]
    keys: tuple[AssignedKey, ...]
    void: tuple[UUID, ...] = ()

    def encode(self) -> bytes:
        return json.dumps(
            {
                "master_SAE_ID": self.master,
                "slave_SAE_IDs": self.slaves,
                "void": [str(key_id) for key_id in self.void],
                "keys": [_fields(key) for key in self.keys],
            }
        ).encode()

    @classmethod
    def decode(cls, body: bytes) -> "Assignment":
        """Return what a body assigns; raise MalformedPacket if it is not one."""
        match decode_json(body, MAX_ASSIGNMENT, MAX_DEPTH):
            case {
                "master_SAE_ID": master,
                "slave_SAE_IDs": list(slaves),
                "void": list(void),
                "keys": list(keys),
                **others,
            } if not others and 0 < len(slaves) <= MAX_NAMES + 1 and len(keys) <= MAX_IDS:
                assignment = cls(
                    decode_name(master),
                    tuple(decode_name(slave) for slave in slaves),
                    tuple(_key(key) for key in keys),
                    tuple(decode_id(text) for text in void),
                )
            case _:
                raise MalformedPacket("no assignment of keys")
        _check_ids(assignment)
        return assignment


def _fields(key: AssignedKey) -> dict[str, Any]:
    masked = {"masked": base64.b64encode(key.masked).decode()} if key.masked else {}
    stored = [str(key_id) for key_id in key.stored]
    return {"key_ID": str(key.key_id), "size": key.size, "stored": stored, **masked}


def _key(fields: object) -> AssignedKey:
    match fields:
        case {"key_ID": key_id, "size": int(size), "stored": list(stored), **rest} if (
            rest.keys() <= {"masked"} and 0 < size <= MAX_BITS and size % 8 == 0
        ):
            masked = decode_base64(rest["masked"]) if "masked" in rest else b""
            if len(masked) not in (0, size // 8):
                raise MalformedPacket(f"{len(masked)} bytes mask a key of {size} bits")
            ids = tuple(decode_id(text) for text in stored)
            return AssignedKey(decode_id(key_id), size, ids, masked)
    raise MalformedPacket("no assigned key")


def _check_ids(assignment: Assignment) -> None:
    stored = [key_id for key in assignment.keys for key_id in key.stored] + list(assignment.void)
    delivered = {key.key_id for key in assignment.keys}
    if len(stored) > MAX_STORED or len(set(stored)) < len(stored):
        raise MalformedPacket(f"stored keys: each once, {MAX_STORED} at most")
    if len(delivered) < len(assignment.keys):
        raise MalformedPacket("a key_ID is assigned twice")
