"""Frames of switches' Bell analysers, as they come to a host's copper."""

import asyncio
import socket
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from typing import Any, Self
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from hosts.middleware.session.errors import SessionError
from hosts.timeouts import ANALYSER_TIMEOUT_S
from wire.analyser_frames import (
    BROADCAST,
    ETHER_TYPE,
    ETHERNET_BYTES,
    HERALDS,
    MEASURING,
    MOST_PAYLOAD,
    PLACES,
    TO_CONTROLLERS,
    AnalyserFrame,
    End,
    Receivers,
    frames_of,
    group_of,
)
from wire.malformed import MalformedPacket
from wire.metadata.vocabulary import Reason
from wire.outcomes import NO_COINCIDENCE

MOST_REPORTS = 64  # that nobody has asked for yet, of each part of a switch
MOST_ANALYSERS = 256  # that a session hears; forged frames may name more
ENDS = {
    End.NO_PARTNER: "the other end's light did not come in time",
    End.CLOSED: "its flow entry ended while it waited there",
    End.UNFIT: "it does not fit the other end's (size, encoding), or the part of the switch",
    End.FAILED: "that part of it has failed",
    End.CUT_OFF: "nothing released it from the memory there in time",
}


@dataclass(frozen=True)
class Swapped:
    """The outcomes of a block at all analysers of a chain."""

    outcomes: NDArray[np.uint8]  # of k pulses the product of all, NO_COINCIDENCE if one has none
    positions: NDArray[np.intp]  # of these in this end's block, shape (k,)
    blocks: list[int]  # which analysers, and their numbers of the block, alike at both ends
    waited_us: dict[int, int]  # in the memories of each switch of a chain, by its place
    attempts: int = 0  # at all stations
    heralded: int = 0  # pairs of the poorest link
    rounds: int = 0  # of purification, of each span of the chain


@dataclass
class Report:
    """The report of a part of a switch on a block, as far as it has come."""

    frame: AnalyserFrame
    is_own: bool  # to this session's group, not to everybody

    def fits(self, pulses: int) -> bool:
        """Whether it can be of a block: only the session's group hears of one without gaps."""
        return self.frame.pulses == pulses or (self.is_own and self.frame.pulses < pulses)


@dataclass
class Reports:
    """Those of one part of a switch, block after block."""

    number: int = 0  # of the block that is coming
    come: bytearray = field(default_factory=bytearray)  # its outcomes so far
    whole: deque[Report] = field(default_factory=lambda: deque(maxlen=MOST_REPORTS))
    last: int = 0  # number of the block that was taken last

    def take(self, frame: AnalyserFrame, is_own: bool) -> None:
        """Take a frame; all of one block have its number, in order."""
        if not frame.first or frame.number != self.number or frame.first != len(self.come):
            self.number, self.come = frame.number, bytearray()
        if frame.first == len(self.come):
            self.come += frame.outcomes
            if len(self.come) >= frame.pulses:
                whole = replace(frame, first=0, outcomes=bytes(self.come))
                self.whole.append(Report(whole, is_own))
                self.come = bytearray()

    def has(self, pulses: int) -> bool:
        """Whether the next block has been reported; drop what does not fit it."""
        while self.whole and not self.whole[0].fits(pulses):
            self.whole.popleft()
        return bool(self.whole)

    def pop(self) -> AnalyserFrame:
        """Return what comes next; raise SessionError if the block before it was lost."""
        frame = self.whole.popleft().frame
        if self.last and frame.number != self.last + 1:
            text = f"block {frame.number} of inner port {frame.port} comes behind block {self.last}"
            raise SessionError(Reason.PROTOCOL, f"{text}: frames of others were lost")
        self.last = frame.number
        return frame


class AnalyserSocket:
    """Reads the outcomes that analysers report, block by block, in the order of calls."""

    def __init__(
        self, outcomes: socket.socket, heralds: socket.socket, session: int, to: Receivers
    ):
        """Read frames of a session's group, heralds to this end alone, and what is to everybody."""
        self._channels = outcomes, heralds
        self._groups = group_of(session), group_of(session, to)
        self._to_controller = group_of(session, Receivers.CONTROLLER)
        self._analysers: defaultdict[bytes, Reports] = defaultdict(Reports)
        self._memory = Reports()  # that at the other end of this end's link
        # The controller's, by number of the block: rounds of purification to do, and what is left.
        self._commands: defaultdict[int, Reports] = defaultdict(Reports)
        self._left: dict[int, AnalyserFrame] = {}
        self._purified = False  # it has had pairs purified
        self._over = 0  # the last block of which no round is to come
        self._copper = ""  # the interface by which the controller's frames come
        self._ended: deque[Report] = deque(maxlen=MOST_REPORTS)  # light, other than measured
        self._turn, self._news = asyncio.Lock(), asyncio.Event()

    @contextmanager
    def reading(self) -> Iterator[Self]:
        """Read frames as they come: sockets hold few."""
        loop = asyncio.get_running_loop()
        for channel in self._channels:
            loop.add_reader(channel.fileno(), self._read)
        try:
            yield self
        finally:
            for channel in self._channels:
                loop.remove_reader(channel.fileno())

    def forget(self) -> None:
        """Drop the frames that have come so far: they are of earlier light."""
        self._read()
        self._analysers.clear()
        self._ended.clear()
        self._memory = Reports()

    def _read(self) -> None:
        """Take all frames that have come to everybody, to this host or to its groups."""
        for channel, group in zip(self._channels, self._groups, strict=True):
            with suppress(BlockingIOError):
                while True:
                    data, at = channel.recvfrom(ETHERNET_BYTES + MOST_PAYLOAD)
                    if not data[0] & 1 or data[:6] in (BROADCAST, group):
                        with suppress(MalformedPacket):
                            self._take(data, AnalyserFrame.decode(data), at)
        self._news.set()

    def _take(self, data: bytes, frame: AnalyserFrame, at: Any) -> None:
        outcomes, heralds = self._groups
        if frame.end in TO_CONTROLLERS:
            if data[:6] == heralds:
                self._take_herald(frame, at)
        elif frame.end not in MEASURING:
            self._ended.append(Report(frame, data[:6] == outcomes))
        else:
            analyser = data[6:12] + frame.port.to_bytes(4)
            if analyser in self._analysers or len(self._analysers) < MOST_ANALYSERS:
                self._analysers[analyser].take(frame, data[:6] == outcomes)

    def _take_herald(self, frame: AnalyserFrame, at: Any) -> None:
        if frame.end == End.STORED:
            self._memory.take(frame, is_own=True)
        elif frame.end == End.PURIFY and self._over < frame.number <= self._over + MOST_REPORTS:
            commands = self._commands[frame.number]
            commands.take(frame, is_own=True)
            self._purified = True
            self._copper = at[0] if at else ""
            if commands.whole and not commands.whole[-1].frame.method:
                self._left[frame.number] = commands.whole.pop().frame

    async def round(self, number: int) -> AnalyserFrame | None:
        """Return a round of purification for a block; None when none is to come."""
        while self._over < number:
            if whole := self._commands[number].whole:
                return whole.popleft().frame
            await self._more()
        self._commands.pop(number, None)
        return None

    async def answer(self, command: AnalyserFrame, bits: NDArray[np.uint8]) -> None:
        """Send the controller what was measured in a round; raise SessionError if copper fails."""
        answer = replace(
            command, end=End.PURIFIED, method=0, pulses=bits.size, outcomes=bits.tobytes()
        )
        loop, kind = asyncio.get_running_loop(), socket.SOCK_RAW | socket.SOCK_NONBLOCK
        try:
            with socket.socket(socket.AF_PACKET, kind) as channel:
                channel.bind((self._copper, 0))
                address = channel.getsockname()[-1]
                async with asyncio.timeout(ANALYSER_TIMEOUT_S):
                    for frame in frames_of(answer):
                        await loop.sock_sendall(channel, frame.encode(self._to_controller, address))
        except OSError as error:
            text = f"{self._copper or 'no interface'}: {str(error) or 'time-out'}"
            raise SessionError(Reason.NO_ANSWER, f"{text}: a round is not reported") from error

    async def next(
        self, pulses: int, analysers: int, limit_s: float = 0.0, number: int = 0
    ) -> Swapped:
        """Return the outcomes of the next block, of this size, at a number of analysers.

        With a limit, of pairs that stations have heralded, which no memory has to find.
        If the controller has had any purified they are of the pairs that it has left of the
        block's number. Raise SessionError if they do not come, or the light has ended otherwise.
        """
        most_s = limit_s or ANALYSER_TIMEOUT_S
        async with self._turn:
            try:
                async with asyncio.timeout(most_s):
                    while len(there := self._there(pulses)) < analysers or (
                        self._purified and number not in self._left
                    ):
                        await self._more()
                    heralds = {each: self._analysers[each].pop() for each in there}
                    self._over = number
                    self._news.set()
                    if (left := self._left.pop(number, None)) is not None:
                        return _corrected(heralds, left, pulses)
                    positions = np.arange(pulses)
                    if not limit_s:
                        positions = await self._positions(pulses, heralds.values())
            except TimeoutError as error:
                text = (
                    f"no outcomes of {pulses} pulses from {analysers - len(self._there(pulses))} "
                    f"of {analysers} analysers in {most_s:g} s: see that flow entries lead "
                    "light to both inputs of each, and its outcomes here, and that the "
                    "switches' agents run"
                )
                raise SessionError(Reason.NO_LIGHT, text) from error
        return _together(heralds, positions)

    async def _more(self) -> None:
        self._news.clear()
        await self._news.wait()

    def _there(self, pulses: int) -> list[bytes]:
        """Return the analysers that have reported the next block; raise what light ended with."""
        while self._ended:
            ended = self._ended.popleft()
            if ended.is_own or ended.fits(pulses):
                text = f"light has ended at inner port {ended.frame.port} of a switch: "
                raise SessionError(Reason.NO_LIGHT, text + ENDS[ended.frame.end])
        return [each for each, reports in self._analysers.items() if reports.has(pulses)]

    async def _positions(self, pulses: int, frames: Iterable[AnalyserFrame]) -> NDArray[np.intp]:
        """Return which pulses of this end's light the memory at the other end of its link holds.

        Its herald of this block was sent before outcomes were.
        """
        self._read()
        gaps = any(frame.pulses < pulses for frame in frames)
        while gaps and not self._memory.has(pulses):
            await self._more()
        if not self._memory.has(pulses):
            return np.arange(pulses)
        herald = self._memory.pop()
        held = np.frombuffer(herald.outcomes, np.uint8) == 0
        if herald.pulses != pulses:
            text = f"a memory holds {herald.pulses} pulses of a block of {pulses}"
            raise SessionError(Reason.PROTOCOL, text)
        return np.flatnonzero(held) if gaps else np.arange(pulses)


def _corrected(frames: dict[bytes, AnalyserFrame], left: AnalyserFrame, pulses: int) -> Swapped:
    """Return the pairs that the controller has left, with its corrections."""
    if not left.waited_us or left.pulses > pulses:
        text = f"{left.pulses} pairs left of {pulses} by {left.waited_us} rounds of purification"
        raise SessionError(Reason.PROTOCOL, text)
    outcomes = np.frombuffer(left.outcomes, np.uint8)
    positions = np.flatnonzero(outcomes != NO_COINCIDENCE)
    whole = _together(frames, positions)
    return replace(whole, outcomes=outcomes[positions], positions=positions, rounds=left.waited_us)


def _together(frames: dict[bytes, AnalyserFrame], positions: NDArray[np.intp]) -> Swapped:
    """Return what the i-th pulses of all blocks make, as many as the poorest block has."""
    most = min(frame.pulses for frame in frames.values())
    each = np.array([np.frombuffer(frame.outcomes, np.uint8)[:most] for frame in frames.values()])
    product = np.bitwise_xor.reduce(each)
    product[(each == NO_COINCIDENCE).any(axis=0)] = NO_COINCIDENCE
    numbers = sorted((crc32(analyser), frame.number) for analyser, frame in frames.items())
    waited_us = {
        analyser[len(PLACES)]: frame.waited_us
        for analyser, frame in frames.items()
        if analyser.startswith(PLACES)
    }
    heralds = [frame for frame in frames.values() if frame.end == End.HERALDED]
    attempts = sum(frame.waited_us for frame in heralds)
    heralded = min((frame.pulses for frame in heralds), default=0)
    blocks = [word for pair in numbers for word in pair]
    return Swapped(product, positions[:most], blocks, waited_us, attempts, heralded)


@contextmanager
def analyser_socket(session: int, to: Receivers) -> Iterator[AnalyserSocket]:
    """Give what takes frames of analysers and memories at all interfaces of a session's end."""
    with (
        _socket(ETHER_TYPE) as outcomes,
        _socket(HERALDS) as heralds,
        AnalyserSocket(outcomes, heralds, session, to).reading() as frames,
    ):
        yield frames


def _socket(kind: bytes) -> socket.socket:
    protocol = socket.htons(int.from_bytes(kind, "big"))
    channel = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, protocol)
    channel.setblocking(False)
    return channel
