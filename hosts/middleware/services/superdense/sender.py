"""The opener of superdense coding: it sends bytes.

    alice                      charlie (source)             bob
      | Setup(SDC) -- held by the controller until the paths are up --> |
      | <--------------- Answer (symbols and operators that bob can use) |
      | Setup(PAIR_SOURCE) ------> |                                    |
      | Emit --------------------> | pairs: half 0 to alice, half 1 to bob
      | <-- light, half 0 -------- | -- light, half 1 ----------------> |
      | Pauli operators, then light, half 0 --------------------------> |
      | Block (what it carried) --------------------------------------> |
      | <------------------------------------------ Report (what came)  |

With the handshake per-pair every pair has a Setup(ONE_PAIR) connection of its own, and the
paths stay up only as long as that connection (paper, figure "handshaking").
"""

import asyncio
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from hashlib import sha256

from hosts.hardware.qnic import BlockName, NoLight, Symbols
from hosts.middleware.services.superdense.frame_format import agreed_format
from hosts.middleware.services.superdense.framing import FramingError
from hosts.middleware.services.superdense.halves import sent_half
from hosts.middleware.services.superdense.options import SuperdenseOptions
from hosts.middleware.services.superdense.outbox import Outbox, OutgoingBlock
from hosts.middleware.services.superdense.per_pair import Agreed, OneByOne
from hosts.middleware.session.channel import SessionError
from hosts.middleware.session.encoding import to_paulis
from hosts.middleware.session.service import Carrier, OpenerEnd
from hosts.network_loop import now_s
from hosts.timeouts import DARK_LIMIT_S, GRACE_S, LIGHT_TIMEOUT_S, REPORT_TIMEOUT_S
from wire.metadata import SYMBOLS, Answer, Block, Handshake, Reason, Report, Setup

ATTEMPTS_LIMIT = 64


@dataclass
class Statistics:
    """What a session has used so far."""

    bell_pairs: int = 0
    lost_pairs: int = 0
    received_symbols: int = 0
    symbol_errors: int = 0
    corrected_symbols: int = 0  # those of the wrong ones that the code has put right
    filled_symbols: int = 0  # lost ones that the code has filled in
    repeated_frames: int = 0
    delivered_bytes: int = 0
    rate_hz: int = 0  # what the session uses; the controller may have overridden it
    frame_bytes: int = 0
    fec: int = 0
    interleave: int = 0
    wavelength_pm: int = 0
    code_rate: float = 1.0  # bits of data for each bit of code, in all frames so far
    symbols: int = 0  # Bell states that the receiver's analyser tells apart; 0: not known yet


async def open_bytes(end: OpenerEnd, _options: SuperdenseOptions) -> Carrier:
    """Prepare the sending of bytes; return the way for them."""
    return Carrier(Sender(end).send)


def check_frames(setup: Setup) -> None:
    """Raise SessionError for frames that no receiver takes."""
    agreed_format(setup, max(SYMBOLS))


class Sender:
    """Sends bytes with the pairs of a source, in the ways that the receiver's analyser allows."""

    def __init__(self, end: OpenerEnd) -> None:
        """Raise SessionError if the receiver does not say what its analyser can do."""
        self._end, self._qnic, self._setup, self._channel = end, end.qnic, end.setup, end.channel
        used = agreed_format(end.setup, _distinguishable_states(end.answer))
        self._outbox = Outbox(end.setup.frame_bytes, end.setup.pairs, used)
        self._encoding = end.answer.encoding
        self._digest = sha256()
        self._size = 0
        self._lit_at_s = now_s()  # when a pair last arrived
        self._one_by_one = OneByOne(self._shake_hands, self._light)
        used_of = "rate_hz", "frame_bytes", "fec", "interleave", "wavelength_pm"
        self.statistics = Statistics(
            symbols=end.answer.symbols, **{name: getattr(end.setup, name) for name in used_of}
        )
        end.counts, end.summary = self._counts, asdict(self.statistics)
        end.sent = 0, self._digest.digest()

    async def send(self, data: bytes) -> None:
        """Send bytes; return when the other end holds every one of them."""
        self._outbox.add(data)
        self.statistics.code_rate = self._outbox.code_rate
        try:
            while not self._outbox.empty:
                await self._send_block(self._outbox.next_block())
            self._digest.update(data)
            self._size += len(data)
            self.statistics.delivered_bytes = self._size
        finally:
            self._end.summary = asdict(self.statistics)
        self._end.sent = self._size, self._digest.digest()

    @property
    def _peer(self) -> str:
        return self._end.arrangement.peer

    def _counts(self) -> Mapping[str, int]:
        """Return what was used so far, as the device reports it."""
        return {
            "pairs_sent": self.statistics.bell_pairs,
            "pairs_lost": self.statistics.lost_pairs,
            "symbol_errors": self.statistics.symbol_errors,
            "repeated_frames": self.statistics.repeated_frames,
        }

    async def _send_block(self, block: OutgoingBlock) -> None:
        self.statistics.bell_pairs += block.symbols.size
        if self._setup.handshake == Handshake.PER_PAIR:
            emitted_ns = await self._one_by_one.send(block.symbols)
        else:
            try:
                paulis = to_paulis(block.symbols, self._encoding)
                emitted_ns = await self._light(block.number, paulis)
            except NoLight as error:
                await self._note_dark(block, error)
                return
        self._channel.send(
            Block(
                self._setup.session,
                block.number,
                block.symbols.size,
                block.refills,
                emitted_ns,
                block.frames,
            )
        )
        self._note(block, await self._channel.receive(Report, REPORT_TIMEOUT_S))

    async def _light(self, number: int, paulis: Symbols) -> int:
        """Have pairs made, modulate this host's halves and send them on."""
        half = BlockName(self._setup.session, number, sent_half(self._setup))
        rate_hz, wavelength_pm = self._setup.rate_hz, self._setup.wavelength_pm
        port = self._qnic.ports[0]
        light = asyncio.create_task(
            self._qnic.modulate(half, paulis, port, rate_hz, wavelength_pm, LIGHT_TIMEOUT_S)
        )
        try:
            await self._end.arrangement.emit(number, paulis.size)
            # The source has answered: its light has arrived, or never will.
            async with asyncio.timeout(GRACE_S + paulis.size / rate_hz):
                return await light
        except TimeoutError as error:
            raise NoLight(f"no light from {self._end.arrangement.source} at {port}") from error
        finally:
            light.cancel()

    async def _shake_hands(self, number: int) -> Agreed:
        """Make the handshake of one pair; the path stays up until its connection is closed."""
        setup = replace(self._setup, handshake=Handshake.ONE_PAIR, block=number, pairs=1)
        channel = await self._end.arrangement.another_channel()
        try:
            answer = await channel.request(setup)
            if _distinguishable_states(answer) != self.statistics.symbols:
                text = f"{self._peer} tells {answer.symbols} Bell states apart, and did not"
                raise SessionError(Reason.PROTOCOL, text)
        except BaseException:
            channel.close()
            raise
        return Agreed(channel, answer.encoding)

    async def _note_dark(self, block: OutgoingBlock, error: NoLight) -> None:
        """Take the block back, and tell the receiver to let go of its halves."""
        self._outbox.dark(block)
        self.statistics.lost_pairs += block.symbols.size
        self._channel.send(Block(self._setup.session, block.number, 0, 0, 0))
        await self._channel.receive(Report, REPORT_TIMEOUT_S)
        self._give_up_if_dark(str(error))

    def _give_up_if_dark(self, what: str) -> None:
        if now_s() - self._lit_at_s > DARK_LIMIT_S:
            raise SessionError(
                Reason.NO_LIGHT,
                f"{what} for {DARK_LIMIT_S:g} s; is a fibre cut, or its loss too high, or do the "
                f"halves of a pair come to {self._peer} further apart than its delay line is long "
                "(analyser.delay_line_km; `qmn spy RUN --kind bell-measure` tells)?",
            )

    def _note(self, block: OutgoingBlock, report: Report) -> None:
        try:
            self._outbox.report(block, report)
        except FramingError as error:
            raise SessionError(Reason.PROTOCOL, str(error)) from error
        statistics = self.statistics
        statistics.lost_pairs += report.lost
        statistics.received_symbols += report.pairs - report.lost
        statistics.symbol_errors = report.errors
        statistics.corrected_symbols = report.corrected
        statistics.filled_symbols = report.filled
        statistics.repeated_frames = self._outbox.repeated_frames
        if report.lost < report.pairs:
            self._lit_at_s = now_s()
        self._give_up_if_dark(f"no pair reached {self._peer}")
        self._give_up_if_too_noisy()

    def _give_up_if_too_noisy(self) -> None:
        for number, attempts in self._outbox.attempts.items():
            if attempts >= ATTEMPTS_LIMIT:
                raise SessionError(
                    Reason.TOO_NOISY,
                    f"frame {number} failed its check {attempts} times: the channel is too noisy "
                    f"for frames of {self._setup.frame_bytes} bytes; choose fewer "
                    "(--frame-bytes), a stronger code (--fec) or less noise",
                )


def _distinguishable_states(answer: Answer) -> int:
    if answer.symbols not in SYMBOLS:
        raise SessionError(Reason.PROTOCOL, "the receiver does not say what its analyser can do")
    return answer.symbols
