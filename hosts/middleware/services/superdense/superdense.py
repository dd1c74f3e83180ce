"""Superdense coding as a service: bytes from the host that opens to the one that accepts.

    alice                        charlie                          bob
      | <------ half 0 ------------ | ------------ half 1 -------> |
      | Pauli operators, then half 0 ----------------------------> |    SDC
      | <---------------------------- Pauli operators, then half 1 |    SDC_RETURN

A return goes back on the light of a session that stands: only the last way of light is its own.
"""

from dataclasses import replace

from hosts.middleware.services.superdense.acceptor import accept_bytes, accepted
from hosts.middleware.services.superdense.opener import open_bytes
from hosts.middleware.services.superdense.options import SuperdenseOptions
from hosts.middleware.services.superdense.sender import check_frames
from hosts.middleware.session.ends import ServiceKind
from wire.metadata.vocabulary import Handshake, Service

KIND = ServiceKind(
    Service.SDC,
    SuperdenseOptions,
    open_bytes,
    accept_bytes,
    accepts=accepted,
    check=check_frames,
    handshakes=(Handshake.FRAMED, Handshake.PER_PAIR, Handshake.ONE_PAIR),
)
RETURN_KIND = replace(KIND, service=Service.SDC_RETURN, handshakes=(Handshake.FRAMED,))
