"""The acceptor of superdense coding: it receives bytes; the mirror of sender.py."""

import asyncio
from collections.abc import Mapping
from hashlib import sha256
from typing import Any

import numpy as np

from hosts.hardware.qnic import NoLight, Symbols
from hosts.middleware.services.superdense.frame_format import FrameFormat, agreed_format
from hosts.middleware.services.superdense.framing import FramingError
from hosts.middleware.services.superdense.halves import arrival_ports
from hosts.middleware.services.superdense.inbox import Inbox
from hosts.middleware.session.channel import MetadataChannel, SessionError, unexpected
from hosts.middleware.session.encoding import (
    DISTINGUISHABLE_STATES,
    agreed_encoding,
    from_bell_states,
)
from hosts.middleware.session.host_resources import HostResources
from hosts.middleware.session.offers import _offer_nothing_but_0, check_light
from hosts.middleware.session.options import MAX_BLOCK_PAIRS, MAX_FRAME_BYTES
from hosts.middleware.session.service import AcceptorEnd
from hosts.timeouts import ARRIVED_TIMEOUT_S, PAIR_TIMEOUT_S
from wire.metadata import Answer, Block, Finish, Handshake, Reason, Report, Setup
from wire.outcomes import NO_COINCIDENCE


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


def accepted(means: HostResources, setup: Setup) -> Answer:
    """Return what is said to a set-up, by what this host's analyser can do; or SessionError."""
    symbols = DISTINGUISHABLE_STATES[means.analyser]
    check_offer(setup, symbols)
    return _answer(setup, symbols, setup.rotation)


def _answer(setup: Setup, symbols: int, rotation: int) -> Answer:
    encoding = agreed_encoding(setup.encoding, symbols, rotation)
    return Answer(setup.session, Reason.OK, symbols=symbols, encoding=encoding)


async def accept_bytes(end: AcceptorEnd) -> None:
    """Receive bytes until the sender has finished; raise SessionError if it does not."""
    receiver = Receiver(end)
    try:
        await receiver.run()
    finally:
        end.summary = receiver.statistics
        receiver.close()


class Receiver:
    """Receives bytes from another host by a Bell analyser."""

    def __init__(self, end: AcceptorEnd) -> None:
        self._end, self._qnic = end, end.qnic
        self._channel, self._setup = end.channel, end.setup
        self._symbols = DISTINGUISHABLE_STATES[end.means.analyser]
        self._format = agreed_format(end.setup, self._symbols)
        self._inbox = Inbox(end.setup.frame_bytes, self._format)
        self._singles: dict[int, asyncio.Task[Symbols]] = {}
        self._singles_used = 0
        self._digest = sha256()
        self.size = 0
        end.counts, end.join = self._counts, self.one_pair

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

    def _counts(self) -> Mapping[str, int]:
        """Return what was used so far, as the device reports it."""
        return {
            "pairs_received": self._inbox.symbols_seen,
            "pairs_lost": self._inbox.symbols_lost,
            "symbol_errors": self._inbox.symbol_errors,
            "repeated_frames": self._inbox.repeated_frames,
        }

    async def run(self) -> None:
        """Receive until the sender has finished; raise SessionError if it does not."""
        while True:
            message = await self._channel.next()
            if isinstance(message, Block):
                await self._receive_block(message)
            elif isinstance(message, Finish):
                self._verify(message)
                return
            else:
                raise unexpected(message, self._channel.peer)

    def close(self) -> None:
        """Let go of handshakes under way."""
        for task in self._singles.values():
            task.cancel()

    async def _receive_block(self, block: Block) -> None:
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
        await self._pass_on(report)

    async def _pass_on(self, report: Report) -> None:
        data = self._inbox.take()
        if data:
            self._digest.update(data)
            self.size += len(data)
            await self._end.deliver(data)
        self._channel.send(report)

    async def _measure(self, number: int, pairs: int) -> Symbols:
        """Bell-measure the two halves of a block; a half that did not come is all lost."""
        try:
            found = await self._qnic.detect_pairs(
                self._setup.session,
                number,
                arrival_ports(self._setup, self._qnic.ports),
                ARRIVED_TIMEOUT_S,
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
        channel.send(_answer(self._setup, self._symbols, setup.rotation))
        await channel.next(PAIR_TIMEOUT_S)  # the sender closes when the light has arrived
        return self._decode(await self._measure(setup.block, 1), setup)

    async def _collect_singles(self, pairs: int) -> Symbols:
        numbers = range(self._singles_used + 1, self._singles_used + pairs + 1)
        self._singles_used += pairs
        unknown = [number for number in numbers if number not in self._singles]
        if unknown:
            raise SessionError(Reason.PROTOCOL, f"pair {unknown[0]} had no handshake")
        tasks = [self._singles.pop(number) for number in numbers]
        try:
            async with asyncio.timeout(PAIR_TIMEOUT_S):
                return np.concatenate(await asyncio.gather(*tasks))
        except TimeoutError as error:
            raise SessionError(
                Reason.PROTOCOL,
                f"pairs up to {numbers[-1]} were not over in {PAIR_TIMEOUT_S:g} s",
            ) from error

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
