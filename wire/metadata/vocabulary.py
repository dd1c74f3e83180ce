"""Words of a set-up message: services, memories, handshakes, codes, verdicts, reasons."""

from enum import IntEnum, unique

from wire.light import registered_services
from wire.malformed import MalformedPacket


class UnknownService(MalformedPacket):
    """A set-up message asks for a service that this version does not know."""


@unique
class Service(IntEnum):
    """The purpose of the light; wire.services has the paths that each needs.

    Services of packages are members, too: Service["SENSE"].
    """

    _ignore_ = "members registered"

    SDC = 1  # superdense coding
    PAIR_SOURCE = 2  # of an open session: its pairs
    DISTRIBUTE = 3  # entanglement distribution
    SDC_RETURN = 9  # superdense coding back to the opener of a session of it, with its light
    SWAP = 17  # entanglement swapping by switches, to which both ends send halves of pairs
    members = vars()
    for registered in registered_services():
        # From Python 3.13 on a class also has the number of its first line.
        if registered.name.upper() in members or registered.number in [
            value for name, value in members.items() if name.isupper()
        ]:
            raise ValueError(
                f"service {registered.name}: qmn has its name or number; choose others"
            )
        members[registered.name.upper()] = registered.number


def service_of(number: int) -> Service:
    """Return the service of a number; raise UnknownService for one that is not known."""
    try:
        return Service(number)
    except ValueError as error:
        services = ", ".join(f"{service.value} ({service.name})" for service in Service)
        raise UnknownService(f"unknown service {number}: choose one of {services}") from error


class MemoryState(IntEnum):
    """The memories' part at both ends, as a set-up requests it."""

    ANY = 0  # keep what comes
    HERALDED = 1  # their qubits emit, and stations in switches herald pairs of them
    # To the source alone: it makes no pairs, but measures the light that both ends send.
    RELAYED = 2


class Handshake(IntEnum):
    """How often light paths are arranged."""

    FRAMED = 1  # once for a session
    PER_PAIR = 2  # a session whose every Bell state has a handshake of its own
    ONE_PAIR = 3  # that handshake (paper, figure "handshaking")


class Fec(IntEnum):
    """Error-correction codes of a session (hosts/middleware/services/superdense/coding)."""

    NONE = 0
    REPETITION = 1  # (3,1)
    HAMMING = 2  # (7,4)
    GOLAY = 3  # (23,12)
    REED_SOLOMON = 4  # (255,223) over bytes, shortened


FEC_NAMES = {fec.name.lower().replace("_", "-"): fec for fec in Fec}  # what users call them
SYMBOLS = (3, 4)  # how many Bell states an analyser can tell apart
PAPER_ENCODING = 0b11_10_01_00  # symbol s is sent as Pauli (encoding >> 2s) & 3: table 1


class Verdict(IntEnum):
    PENDING = 0
    GRANTED = 1
    REFUSED = 2


class Reason(IntEnum):
    """Why a request was refused; OK if it was not."""

    OK = 0
    NOT_ARBITRATED = 1
    NO_LISTENER = 2
    UNKNOWN_HOST = 3
    NO_PATH = 4
    BUSY = 5
    UNKNOWN_SESSION = 6
    UNSUPPORTED = 7
    SWITCH_FAILED = 8
    SWITCH_TIMEOUT = 9
    NO_LIGHT = 10
    TOO_NOISY = 11
    WRONG_DIGEST = 12
    HARDWARE = 13
    PROTOCOL = 14
    NOT_ALLOWED = 15
    LOSS_TOO_HIGH = 16
    NO_WAVELENGTH = 17
    # Written by the controller, with the address of the node that lacks the feature as source.
    CANNOT_EMIT = 19
    CANNOT_STORE = 20
    CANNOT_GATE = 21
    CANNOT_MEASURE = 22
    NO_CHAIN = 23
    FIBER_CUT = 24  # written by the controller, with the address of the host whose fibre it is
    # Written by the controller, with the address of the node that lacks the feature as source.
    CANNOT_HERALD = 26
    CANNOT_INTERFERE = 27
    PATH_BROKEN = 25  # within the optical network
    TOO_LATE = 28  # no light by the deadline that the set-up message names
    NO_ANSWER = 29  # the other end was silent for too long
    PEER_GONE = 30  # it has closed the connection, or lost it
    CANNOT_ABSORB = 31  # written by the controller, with the address of the node as source
    SETUP_UNSEEN = 32  # a quantum switch has got no copy of the set-up message itself
