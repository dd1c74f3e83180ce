"""MDI-QKD: both ends send pulses to a relay, which measures them in pairs and announces.

    opener                                   acceptor                 relay
      | Values(COMING) ---------------------> |  prepares pulses        |
      | <------------------------- Answer(OK) |                         |
      | Values(LAUNCH) ---------------------> |                         |
      |   light ----------------------------------------------------->  |
      |                                       |   light ------------->  |
      | Emit -------------------------------------------------------->  |
      | <---- Answer(OK), Values(ARRIVED), Values(OUTCOMES): Bell states |
      | Values(ARRIVED), Values(OUTCOMES) --> |  turns its bits by them |
      | Values(OVER) -----------------------> |  sifting, as of BB84    |

The announced Bell state of two pulses shows whether their bits are alike, and not what they
are (Lo, Curty, Qi, Phys. Rev. Lett. 108, 130503): nobody trusts the
relay, and what it says has no tag. A lie is an error of the key, as noise is. The clocks of both
ends are taken to agree, and their pulses to be sent so that they meet. No socket, no clock.
"""

from dataclasses import dataclass

import numpy as np

from applications.key_distribution.acceptor import BlockOfLight, Introduced, out_of_turn
from applications.measured_light import random_bases
from applications.qkd.decoy import LEVELS, SHARES
from applications.qkd.sifting import Record
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols
from hosts.middleware.services.source import relayed_blocks
from hosts.middleware.session.errors import SessionError, unsupported
from hosts.middleware.session.protocol import (
    Announce,
    Concurrently,
    HostSide,
    OpenerSide,
    Say,
    Steps,
    do,
)
from hosts.middleware.session.values import announced, announcement, expect
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason
from wire.outcomes import NO_CLICK, NO_COINCIDENCE

MOST_LEVELS = 3
SAME = 1e-9  # by which probabilities of equal sources may differ


@dataclass
class Pulses:
    """A block of pulses in random states, ready to be sent."""

    side: HostSide
    number: int
    name: BlockName
    bases: Symbols
    bits: Symbols
    levels: Symbols | None
    found: Symbols | None = None  # what the relay has announced
    launched: bool = False
    arrived: Values | None = None  # the first half of the announcement

    def send(self) -> Steps[None]:
        """Send the pulses; over when they have left."""
        setup = self.side.setup
        yield from do(Qnic.send, self.name, self.side.ports[0], setup.rate_hz, setup.wavelength_pm)

    def record(self) -> Steps[Record]:
        """Return the bits as they are alike at both ends, where the relay has found something."""
        yield from ()
        if self.found is None:
            raise SessionError(Reason.PROTOCOL, f"block {self.number} is over, unannounced")
        states = self.found ^ np.uint8(self.side.setup.rotation)
        bits = fitting(self.bits, self.bases, states)
        bits[self.found == NO_COINCIDENCE] = NO_CLICK
        return Record(self.bases, bits, self.levels)

    def heard(self, message: Values) -> Steps[None]:
        """Take the word to launch, or what the relay has announced."""
        match message.topic:
            case Topic.LAUNCH if not self.launched:
                ours = LEVELS if self.levels is not None else 1
                (theirs,) = expect(message, Topic.LAUNCH, self.number, 1, MOST_LEVELS).tolist()
                if theirs != ours:
                    raise unsupported(unlike(self.side, theirs, ours))
                self.launched = True
                yield Concurrently(self.send())
            case Topic.ARRIVED if self.launched and self.arrived is None:
                self.arrived = message
            case Topic.OUTCOMES if self.arrived is not None and self.found is None:
                self.found = announced(self.arrived, message, self.number, self.bits.size)
            case _:
                raise out_of_turn(message, self.side.peer)


def unlike(side: HostSide, theirs: int, ours: int) -> str:
    return (
        f"mdi of pulses of {theirs} and of {ours} intensities: give the sources of {side.peer} and "
        f"{side.host} decoys, or neither of them"
    )


def fitting(bits: Symbols, bases: Symbols, states: Symbols) -> Symbols:
    """Return bits turned so that they are those of the other pulse, if the two were in this state.

    In Psi states bits of Z are unlike, in those with a minus bits of X.
    """
    fits: Symbols = bits ^ (states >> bases & np.uint8(1))
    return fits


def prepared(
    side: HostSide, number: int, photons: int, name: BlockName, decoys: bool
) -> Steps[Pulses]:
    """Prepare a block of pulses in random states, of random intensities if there are decoys."""
    bases = random_bases(side, photons)
    bits = side.draws.integers(0, 2, photons, dtype=bases.dtype)
    levels = side.draws.choice(LEVELS, photons, p=SHARES).astype(np.uint8) if decoys else None
    yield from do(Qnic.prepare, name.session, name.number, 2 * bases + bits, levels)
    return Pulses(side, number, name, bases, bits, levels)


def send_to_relay(side: OpenerSide, number: int, photons: int, *, decoys: bool) -> Steps[Record]:
    """Have both ends send a block to the relay; return what this one knows of it."""
    name, _other = relayed_blocks(side.setup.session, number)
    pulses = yield from prepared(side, number, photons, name, decoys)
    yield side.say(Topic.LAUNCH, number, [LEVELS if decoys else 1], 8)
    yield from pulses.send()
    heralds = yield Announce(number, photons)
    yield Say(announcement(side.setup.session, number, heralds))
    return Record(pulses.bases, pulses.bits, pulses.levels)


def get_ready(side: HostSide, number: int, photons: int, *, decoys: bool) -> Steps[BlockOfLight]:
    """Prepare a block of pulses, to be sent when the opener says so."""
    _other, name = relayed_blocks(side.setup.session, number)
    return (yield from prepared(side, number, photons, name, decoys))


def check_source(opener: Introduced, host: str, several: float) -> None:
    """Raise SessionError if this host's source emits several photons more than the opener's.

    That is in how many of its pulses.
    """
    if either(several, several) > opener.parameters.multi_photon + SAME:
        raise unsupported(
            f"{host} emits several photons in {several:.3g} of its pulses, more than "
            f"{opener.peer}: give them the same source, or ask from {host}",
        )


def either(one: float, other: float) -> float:
    """Return how likely a pulse of at least one end has several photons."""
    return 1 - (1 - one) * (1 - other)
