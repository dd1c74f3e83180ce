"""The proposal of a conference key: what its leader tells all others, before any light.

    +---------+---------+-------+---------+---------+-------------------------+
    | version | session | bound | eps_sec | eps_cor | names of all, UTF-8     |
    +---------+---------+-------+---------+---------+-------------------------+
      u8        u64       u8      f64       f64       commas between, leader first

Network byte order. It travels in an envelope, and the later proofs include it.
"""

import struct
from dataclasses import dataclass

from applications.qkd.messages import Bound
from wire.malformed import MalformedPacket

VERSION = 1
MOST_NAMES_BYTES = 1024
_FIELDS = struct.Struct("!BQBdd")


@dataclass(frozen=True)
class ConferenceProposal:
    session: int  # by which all know it
    bound: Bound
    eps_sec: float  # that it is not secret, at most
    eps_cor: float  # that it is not the same everywhere, at most
    names: tuple[str, ...]

    def encode(self) -> bytes:
        fixed = _FIELDS.pack(VERSION, self.session, self.bound, self.eps_sec, self.eps_cor)
        return fixed + ",".join(self.names).encode()

    @classmethod
    def decode(cls, data: bytes) -> "ConferenceProposal":
        """Return a proposal; raise MalformedPacket for anything else."""
        if not _FIELDS.size < len(data) <= _FIELDS.size + MOST_NAMES_BYTES:
            raise MalformedPacket(f"a proposal of {len(data)} bytes")
        version, session, bound, eps_sec, eps_cor = _FIELDS.unpack_from(data)
        if version != VERSION:
            raise MalformedPacket(f"a proposal of version {version}, not {VERSION}")
        if bound not in list(Bound) or not (0 < eps_sec < 1 and 0 < eps_cor < 1):
            raise MalformedPacket(f"a proposal with bound {bound}, eps {eps_sec}, {eps_cor}")
        try:
            names = tuple(data[_FIELDS.size :].decode().split(","))
        except UnicodeDecodeError as error:
            raise MalformedPacket(f"names of a proposal: {error}") from error
        if len(set(names)) != len(names) or not all(names):
            raise MalformedPacket(f"names of a proposal: {names}")
        return cls(session, Bound(bound), eps_sec, eps_cor, names)
