"""The ICMP error that tells an application why light cannot be had."""

from collections.abc import Mapping
from types import MappingProxyType

from applications.ip_over_light.lost_packet import Unreachable
from wire.metadata.vocabulary import Reason

CODES: Mapping[Reason, Unreachable] = MappingProxyType(
    {
        Reason.NOT_ALLOWED: Unreachable.PROHIBITED,
        Reason.NO_PATH: Unreachable.NETWORK,
        Reason.NO_WAVELENGTH: Unreachable.NETWORK,
        Reason.PATH_BROKEN: Unreachable.NETWORK,
        Reason.LOSS_TOO_HIGH: Unreachable.NETWORK,
    }
)
# Reasons that may pass in a moment: others have the light, the return's session is just over, or
# the other host, or its q0, is not up yet.
PASSING = frozenset(
    {
        Reason.BUSY,
        Reason.UNKNOWN_SESSION,
        Reason.NO_LISTENER,
        Reason.UNKNOWN_HOST,
        Reason.NO_ANSWER,
    }
)


def code(reason: Reason) -> Unreachable:
    """Return why the destination is unreachable: the host, if it is nothing more special."""
    return CODES.get(reason, Unreachable.HOST)
