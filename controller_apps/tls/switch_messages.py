"""Messages of a switch, cut out of its connection; one of them says who it is."""

import struct
from collections.abc import Collection

from wire.metadata import MalformedPacket

HEADER = struct.Struct("!BBHI")  # of OpenFlow, of any version
FEATURES_REPLY = 6  # of any version, too
DATAPATH_ID = struct.Struct("!Q")  # with which its body begins


class Impostor(Exception):
    """A switch gives itself out as another one than its certificate names."""


class SwitchMessages:
    """Passes whole messages on, and no word of a switch that its certificate does not name."""

    def __init__(self, datapath_ids: Collection[int]) -> None:
        """Say which switches may speak on the connection."""
        self._datapath_ids = datapath_ids
        self._data = bytearray()

    def feed(self, data: bytes) -> bytes:
        """Return the messages that are whole now; raise Impostor or MalformedPacket."""
        self._data += data
        end = 0
        while len(self._data) - end >= HEADER.size:
            _version, kind, length, _xid = HEADER.unpack_from(self._data, end)
            if length < HEADER.size:
                raise MalformedPacket(f"OpenFlow: a message of {length} bytes")
            if len(self._data) - end < length:
                break
            if kind == FEATURES_REPLY:
                self._identify(bytes(self._data[end + HEADER.size : end + length]))
            end += length
        whole = bytes(self._data[:end])
        del self._data[:end]
        return whole

    def _identify(self, body: bytes) -> None:
        if len(body) < DATAPATH_ID.size:
            raise MalformedPacket(f"OpenFlow: features of {len(body)} bytes")
        (datapath_id,) = DATAPATH_ID.unpack_from(body)
        if datapath_id not in self._datapath_ids:
            raise Impostor(f"poses as switch {datapath_id:#x}")
