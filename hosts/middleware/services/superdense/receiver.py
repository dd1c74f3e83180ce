"""The receiving end of a superdense-coding session: the mirror of sender.py."""

import asyncio
from collections.abc import Awaitable, Callable
from hashlib import sha256
from typing import Any

import numpy as np

from hosts.hardware.qnic import NoLight, Qnic, Symbols, release
from hosts.middleware.services.superdense.frame_format import FrameFormat, agreed_format
from hosts.middleware.services.superdense.framing import FramingError
from hosts.middleware.services.superdense.inbox import Inbox
from hosts.middleware.session.channel import MetadataChannel, SessionError, unexpected
from hosts.middleware.session.encoding import (
    DISTINGUISHABLE_STATES,
    agreed_encoding,
    from_bell_states,
)
from hosts.middleware.session.offers import _offer_nothing_but_0, check_light
from hosts.middleware.session.options import MAX_BLOCK_PAIRS, MAX_FRAME_BYTES
from wire.metadata import Answer, Block, Finish, Handshake, Reason, Report, Setup
from wire.outcomes import NO_COINCIDENCE

ARRIVAL_TIMEOUT_S = 0.1  # the sender speaks of a block only when its light has arrived
SETTLE_TIMEOUT_S = 30.0

Deliver = Callable[[bytes], Awaitable[None]]


def check_offer(setup: Setup, symbols: int) -> FrameFormat:
    """Return what frames are made of; raise SessionError for a set-up that cannot be served."""
    check_light(setup)
    _offer_nothing_but_0({"fidelity at least": setup.fidelity_ppm})
    if setup.frame_bytes > MAX_FRAME_BYTES or setup.pairs > MAX_BLOCK_PAIRS:
        raise SessionError(
            Reason.UNSUPPORTED,
            f"frames of {setup.frame_bytes} bytes in blocks of {setup.pairs} pairs; at most "
            f"{MAX_FRAME_BYTES} and {MAX_BLOCK_PAIRS}",
        )
    return agreed_format(setup, symbols)


class ReceivingSession:
    """A session from another host to this one, whose Bell analyser is of a kind."""

    def __init__(self, qnic: Qnic, channel: MetadataChannel, setup: Setup, analyser: str) -> None:
        self._symbols = DISTINGUISHABLE_STATES[analyser]
        self._format = check_offer(setup, self._symbols)
        if len(qnic.ports) < 2:
            raise SessionError(Reason.UNSUPPORTED, "a receiver needs two fibres")
        self._qnic = qnic
        self._channel = channel
        self._setup = setup
        self.closed = False
        self._inbox = Inbox(setup.frame_bytes, self._format)
        self._singles: dict[int, asyncio.Task[Symbols]] = {}
        self._singles_used = 0
        self._digest = sha256()
        self.size = 0

    @property
    def setup(self) -> Setup:
        """What was agreed on in the handshake."""
        return self._setup

    @property
    def statistics(self) -> dict[str, Any]:
        """Counts for the application and for diagnosis.

        `confusion` has a row for each symbol sent and a column for each received, of the frames
        that have arrived: before their check is right, nobody here knows what was sent.
        """
        return {
            "bytes": self.size,
            "symbols": self._inbox.symbols_seen,
            "lost_pairs": self._inbox.symbols_lost,
            "symbol_errors": self._inbox.symbol_errors,
            "corrected_symbols": self._inbox.corrected_symbols,
            "filled_symbols": self._inbox.filled_symbols,
            "repeated_frames": self._inbox.repeated_frames,
            "confusion": self._inbox.confusion.tolist(),
        }

    async def run(self, deliver: Deliver) -> None:
        """Receive until the sender has finished; raise SessionError if it does not."""
        self._channel.send(self._acceptance(self._setup))
        while True:
            message = await self._channel.next()
            if isinstance(message, Block):
                await self._receive_block(message, deliver)
            elif isinstance(message, Finish):
                self._verify(message)
                return
            else:
                raise unexpected(message, self._channel.peer)

    def confirm(self) -> None:
        """Tell the sender that all bytes were right and are delivered."""
        self._channel.send(Answer(self._setup.session, Reason.OK))

    async def close(self) -> None:
        """Let go of photons and of handshakes under way."""
        self.closed = True
        for task in self._singles.values():
            task.cancel()
        await release(self._qnic, self._setup.session)

    async def _receive_block(self, block: Block, deliver: Deliver) -> None:
        longest_frame = self._format.pairs(self._setup.frame_bytes)
        if block.pairs > max(self._setup.pairs, longest_frame):
            raise SessionError(Reason.PROTOCOL, f"block {block.block} has {block.pairs} pairs")
        if block.pairs == 0:  # no light reached the sender
            await self._qnic.discard_block(self._setup.session, block.block)
            symbols = np.empty(0, dtype=np.uint8)
        elif self._setup.handshake == Handshake.PER_PAIR:
            symbols = await self._collect_singles(block.pairs)
        else:
            symbols = self._decode(await self._measure(block.block, block.pairs), self._setup)
        try:
            report = self._inbox.block(block, symbols)
        except FramingError as error:
            raise SessionError(Reason.PROTOCOL, str(error)) from error
        await self._pass_on(report, deliver)

    async def _pass_on(self, report: Report, deliver: Deliver) -> None:
        data = self._inbox.take()
        if data:
            self._digest.update(data)
            self.size += len(data)
            await deliver(data)
        self._channel.send(report)

    async def _measure(self, number: int, pairs: int) -> Symbols:
        """Bell-measure the two halves of a block; a half that did not come is all lost."""
        try:
            found = await self._qnic.detect_pairs(
                self._setup.session,
                number,
                (self._qnic.ports[1], self._qnic.ports[0]),
                ARRIVAL_TIMEOUT_S,
            )
        except NoLight:
            return np.full(pairs, NO_COINCIDENCE, dtype=np.uint8)
        if found.outcomes.size != pairs:
            raise SessionError(
                Reason.PROTOCOL, f"block {number}: {found.outcomes.size} pairs of light"
            )
        return found.outcomes

    async def one_pair(self, channel: MetadataChannel, setup: Setup) -> None:
        """Serve the handshake of a single pair: accept, wait for its end, measure."""
        if channel.peer != self._channel.peer:
            text = f"pair {setup.block} of a session of {self._channel.peer} from {channel.peer}"
            raise SessionError(Reason.UNKNOWN_SESSION, text)
        used = setup.block in self._singles or setup.block <= self._singles_used
        if self._setup.handshake != Handshake.PER_PAIR or used:
            text = f"pair {setup.block} is not expected (any more): is its set-up a replay?"
            raise SessionError(Reason.PROTOCOL, text)
        if len(self._singles) >= MAX_BLOCK_PAIRS:
            raise SessionError(Reason.PROTOCOL, "too many pairs without a block message")
        self._singles[setup.block] = asyncio.create_task(self._single(channel, setup))
        await asyncio.wait([self._singles[setup.block]])

    async def _single(self, channel: MetadataChannel, setup: Setup) -> Symbols:
        channel.send(self._acceptance(setup))
        await channel.next(SETTLE_TIMEOUT_S)  # the sender closes when the light has arrived
        return self._decode(await self._measure(setup.block, 1), setup)

    async def _collect_singles(self, pairs: int) -> Symbols:
        numbers = range(self._singles_used + 1, self._singles_used + pairs + 1)
        self._singles_used += pairs
        unknown = [number for number in numbers if number not in self._singles]
        if unknown:
            raise SessionError(Reason.PROTOCOL, f"pair {unknown[0]} had no handshake")
        tasks = [self._singles.pop(number) for number in numbers]
        try:
            async with asyncio.timeout(SETTLE_TIMEOUT_S):
                return np.concatenate(await asyncio.gather(*tasks))
        except TimeoutError as error:
            raise SessionError(
                Reason.PROTOCOL,
                f"pairs up to {numbers[-1]} were not over in {SETTLE_TIMEOUT_S:g} s",
            ) from error

    def _acceptance(self, granted: Setup) -> Answer:
        return Answer(
            granted.session,
            Reason.OK,
            symbols=self._symbols,
            encoding=self._encoding(granted),
        )

    def _encoding(self, granted: Setup) -> int:
        return agreed_encoding(self._setup.encoding, self._symbols, granted.rotation)

    def _decode(self, outcomes: Symbols, granted: Setup) -> Symbols:
        encoding = self._encoding(granted)
        return from_bell_states(outcomes, encoding, granted.rotation, self._symbols)

    def _verify(self, finish: Finish) -> None:
        if (finish.size, finish.sha256) != (self.size, self._digest.digest()):
            raise SessionError(
                Reason.WRONG_DIGEST,
                f"{self.size} of {finish.size} bytes arrived, or their SHA-256 differs",
            )
