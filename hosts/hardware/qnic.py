"""The interface of a QNIC to the middleware, whatever hardware stands behind it.

Blocks of k photons are named as on the wire: (session, number, half). A driver for real
equipment implements the same calls (paper, section "Host Nodes").
"""

import logging
from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.operations import BlockName, Operation

log = logging.getLogger("qnic")

Symbols = NDArray[np.uint8]
Positions = NDArray[np.integer]
LocalGate = Literal["H", "S", "S_DAG"]
LEFT_ALONE = 255  # instead of a basis


class HardwareError(Exception):
    """The hardware refused or failed; the text names the value and the remedy."""


class NoLight(HardwareError):
    """No photon of a block arrived in time."""


@dataclass(frozen=True)
class Coincidences:
    """What the Bell analyser reports for a block: Bell states, 255 where it saw none."""

    outcomes: Symbols  # shape (k,): 0 Phi+, 1 Psi+, 2 Phi-, 3 Psi-
    clicks: int
    time_ns: int


@dataclass(frozen=True)
class Outcomes:
    """What detectors tell of a block: 0 or 1 for each photon, 255 where none clicked."""

    outcomes: Symbols  # shape (k,)
    time_ns: int


@dataclass(frozen=True)
class Stored:
    """What a memory has taken."""

    arrived: NDArray[np.bool_]  # shape (k,): whether each photon is in it
    since_ns: int  # the mean time from which they wait there


@dataclass(frozen=True)
class Heralds:
    """What a station tells of a block of attempts."""

    states: Symbols  # shape (n,): the Bell state of each pair, 0 Phi+, 1 Psi+, 2 Phi-, 3 Psi-
    attempts: int  # those of all modes


@dataclass(frozen=True)
class Directions:
    """Directions on the Bloch sphere, of k photons; both of shape (k,)."""

    theta_rad: NDArray[np.float64]  # from |0>
    phi_rad: NDArray[np.float64]  # about the Z axis, from |+>


@dataclass(frozen=True)
class Received:
    """What has been received: places for photons, and when the first and last of them came."""

    photons: int
    first_ns: int
    last_ns: int


class Qnic(Protocol):
    """The light ports of a host and its source, modulators and detectors."""

    @property
    def ports(self) -> list[str]:
        """Interface names of the fibres, in order."""

    async def emit_pairs(
        self,
        session: int,
        number: int,
        count: int,
        ports: tuple[str, str],
        rate_hz: int,
        wavelength_pm: int,
    ) -> None:
        """Make count Bell pairs Phi+ and send their halves 0 and 1 into two ports.

        Return when the last photon has left.
        """

    async def begin_pairs(
        self,
        session: int,
        number: int,
        count: int,
        ports: tuple[str, str],
        rate_hz: int,
        wavelength_pm: int,
    ) -> None:
        """Do what `emit_pairs` does behind what was begun of a session before; return at once.

        Raise HardwareError if one of those has failed.
        """

    async def pairs_over(self, session: int) -> None:
        """Wait until the last photon of all pairs that were begun has left.

        Raise HardwareError if some could not be made.
        """

    async def share_pairs(
        self, session: int, number: int, count: int, port: str, rate_hz: int, wavelength_pm: int
    ) -> Stored:
        """Make count Bell pairs Phi+, store their halves 0, and send halves 1 into a port.

        Return what the memory has taken, when the last photon has left.
        """

    async def attempt(self, block: BlockName, port: str, wavelength_pm: int) -> None:
        """Let qubits of the memory attempt to emit into a port, as half of a block to be heralded.

        The block is in the memory when the station has told of it.
        """

    async def herald(
        self, session: int, number: int, count: int, ports: tuple[str, str], timeout_s: float
    ) -> Heralds:
        """Herald so many pairs of qubits whose light comes to two ports, or those of the time."""

    async def modulate(
        self,
        block: BlockName,
        paulis: Symbols,
        port: str,
        rate_hz: int,
        wavelength_pm: int,
        timeout_s: float,
    ) -> int:
        """Apply one Pauli operator (two bits: X, Z) to each photon that arrives; shape (k,).

        The photons leave by the port they came from. Return the time (ns) at which the first
        one left, when the last has. Raise NoLight if none arrives.
        """

    async def detect_pairs(
        self,
        session: int,
        number: int,
        ports: tuple[str, str],
        timeout_s: float,
        following: bool = False,
    ) -> Coincidences:
        """Make Bell measurements on the halves 0 and 1 that arrive at two ports.

        Raise NoLight if no photon of a half arrives; what came of the other is here still.
        Following: the blocks behind this one will be asked for, too, one after the other, each with
        this time-out; the hardware may measure them as they arrive. Whoever asks no more cancels
        the wait for one of them, or discards the session.
        """

    async def detect_arrivals(
        self, blocks: tuple[BlockName, BlockName], ports: tuple[str, str], timeout_s: float
    ) -> Coincidences:
        """Make Bell measurements on two blocks that arrive at two ports, made by two hosts.

        Raise NoLight if no photon of one of them arrives; what came of the other is discarded.
        """

    async def prepare(
        self, session: int, number: int, states: Symbols, levels: Symbols | None = None
    ) -> BlockName:
        """Make a photon in each of these states (half 0), at this host; shape (k,).

        States: 0 |0>, 1 |1>, 2 |+>, 3 |->, 4 |+i>, 5 |-i>. Levels, shape (k,): the intensity of
        each pulse, 0 the source's mean, 1 and 2 its decoys; None: 0 for all.
        """

    async def prepare_along(self, session: int, number: int, directions: Directions) -> BlockName:
        """Make a photon (half 0) in cos(theta/2) |0> + exp(i phi) sin(theta/2) |1> for each."""

    async def send(self, block: BlockName, port: str, rate_hz: int, wavelength_pm: int) -> int:
        """Send photons of this host into a port; return when (ns) the first one left.

        Return when the last photon has left.
        """

    def arrivals(self, port: str) -> AsyncIterator[BlockName]:
        """Yield blocks that arrive at a port after this call, where they wait to be received.

        Raise HardwareError if it cannot go on.
        """

    async def receive(self, block: BlockName, port: str, timeout_s: float) -> Received:
        """Take the photons that arrive at a port; raise NoLight if none does."""

    async def resend(self, block: BlockName, bases: Symbols) -> Symbols:
        """Measure photons at this host and put new ones in their places, in the states found.

        Each has a basis (0 Z, 1 X, 2 Y) or is left alone (255); shape (k,). Return 0 or 1 for
        each, 255 where none was measured or no detector clicked: there, no photon is left.
        """

    async def split(self, block: BlockName, into: BlockName) -> Symbols:
        """Count the photons of each pulse at this host; return the counts, shape (k,).

        One photon of each pulse that has several goes into a new block, in the place of its pulse.
        """

    async def receive_into_memory(self, block: BlockName, port: str, timeout_s: float) -> Stored:
        """Store the photons that arrive at a port; raise NoLight if none does.

        From then on they decohere until they are used.
        """

    def give_up(self, *blocks: BlockName) -> None:
        """Let nobody wait any longer for light of these blocks: whoever does hears NoLight.

        An operation that has its light goes on to its end.
        """

    async def apply(self, block: BlockName, paulis: Symbols) -> int:
        """Apply one Pauli operator (two bits: X, Z) to each photon at this host; shape (k,).

        Return when (ns) that was done.
        """

    async def rotate(self, block: BlockName, gates: Sequence[LocalGate]) -> None:
        """Apply gates, one after the other, to every photon of a block at this host."""

    async def controlled_x(self, control: BlockName, target: BlockName) -> None:
        """Apply CX to pairs of photons of two blocks of one size at this host."""

    def set_cutoff(self, cutoff_s: float) -> None:
        """Let the memory drop what it has kept for longer, from now on; infinite: nothing."""

    async def store(self, block: BlockName, for_good: bool = False) -> Stored:
        """Put photons at this host into memory, where they decohere until they are used.

        What is too old is dropped, and not among those told; nothing that is stored for good.
        """

    async def gather(
        self, into: BlockName, picks: Mapping[BlockName, Positions], keep_rest: bool = False
    ) -> None:
        """Make a block of photons at this host, by their positions in blocks, in this order.

        The rest is discarded or, to be kept, stays where it is; at least one photon is picked.
        What is picked from stored blocks alone is stored, too.
        """

    async def measure(self, block: BlockName, bases: Symbols) -> Symbols:
        """Measure photons at this host, each in a basis (0 Z, 1 X, 2 Y); shape (k,).

        Return 0 or 1 for each, 255 where no detector clicked; the photons are used up.
        """

    async def outcomes(
        self, block: BlockName, bases: Symbols, paulis: Symbols | None = None
    ) -> Outcomes:
        """Measure photons as `measure` does, behind Pauli operators, if any; also say when."""

    async def measure_along(
        self, block: BlockName, directions: Directions, paulis: Symbols
    ) -> Outcomes:
        """Let photons at this host pass Paulis, and measure them behind turns of directions to |0>.

        Return 0 for one found in its direction and 1 for the opposite, 255 where no detector
        clicked, and when; the photons are used up.
        """

    async def sense(self, block: BlockName) -> None:
        """Let photons at this host take the phase of what it senses, which nobody is told."""

    async def measure_at(self, block: BlockName, angle_rad: float) -> Symbols:
        """Measure photons at this host between X (angle 0) and Y (pi/2); shape (k,).

        Return 0 for |0> + exp(i angle) |1> and 1 for the opposite, 255 where no detector clicked;
        the photons are used up.
        """

    async def measure_arrivals(
        self, block: BlockName, port: str, bases: Symbols, timeout_s: float
    ) -> Symbols:
        """Measure the photons that arrive at a port, as `measure` does; NoLight if none does."""

    async def bell_measure(self, first: BlockName, second: BlockName) -> Symbols:
        """Make Bell measurements on pairs of photons at this host; shape (k,).

        Return 0 Phi+, 1 Psi+, 2 Phi-, 3 Psi- for each pair, 255 where there was no coincidence.
        """

    async def coincidences(self, first: BlockName, second: BlockName) -> Coincidences:
        """Make Bell measurements as `bell_measure` does; also say when, and how many clicks."""

    async def process(self, operations: "Sequence[Operation]") -> list[int]:
        """Do operations on single qubits at this host, one after the other.

        Return the outcome of each measurement: 0 or 1, 255 where no detector clicked. If one
        fails, what was done before it is done, and what comes behind it is not.
        """

    async def tell(self, instructions: str) -> None:
        """Tell those who watch what is executed now; hardware that nobody watches does nothing."""

    async def look(self, block: BlockName, entangled: bool) -> "NDArray[np.complex128]":
        """Return the density matrix of a qubit here, perhaps with all it is entangled with.

        Only where states are simulated, and may be looked at; raise HardwareError otherwise.
        """

    async def discard_block(self, session: int, number: int) -> None:
        """Discard what has come of both halves of a block."""

    def watch(self, session: int, history: bool, follow: bool) -> AsyncIterator[bytes]:
        """Yield what happens at this host (wire.events), of one session or, with 0, of all.

        History: begin with what is remembered. Follow: go on with what happens. Raise
        HardwareError if it cannot go on.
        """

    async def discard(self, session: int) -> None:
        """Discard all photons of a session, also of those still on their way."""


async def release(qnic: Qnic, session: int) -> None:
    """Discard a session at its end; a fault here must not hide why it has ended."""
    try:
        await qnic.discard(session)
    except HardwareError as error:
        log.warning("session %016x: %s", session, error)
