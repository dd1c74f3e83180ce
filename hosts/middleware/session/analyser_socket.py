"""Frames of switches' Bell analysers, as they come to a host's copper."""

import asyncio
import socket
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
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
    MOST_PAYLOAD,
    PLACES,
    AnalyserFrame,
    End,
    Receivers,
    group_of,
)
from wire.malformed import MalformedPacket
from wire.metadata.vocabulary import Reason
from wire.outcomes import NO_COINCIDENCE

LONGEST = ETHERNET_BYTES + MOST_PAYLOAD
PLACE = len(PLACES)
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


class AnalyserSocket:
    """Reads the outcomes that analysers report, block by block, in the order of calls."""

    def __init__(
        self, outcomes: socket.socket, heralds: socket.socket, session: int, to: Receivers
    ):
        """Read frames of a session's group, heralds to this end alone, and what is to everybody."""
        self._channel, self._heralds = outcomes, heralds
        self._group, self._alone = group_of(session), group_of(session, to)
        self._begun: dict[bytes, AnalyserFrame] = {}  # of each analyser, what is not whole yet
        # Whole ones of each analyser, and whether they are to the session's own group.
        self._whole: defaultdict[bytes, deque[tuple[AnalyserFrame, bool]]] = defaultdict(deque)
        self._last: dict[bytes, int] = {}  # numbers of blocks that were taken
        self._held = b""  # of a herald that is not whole yet
        self._heralded: deque[bytes] = deque()  # whole ones
        self._turn = asyncio.Lock()

    def forget(self) -> None:
        """Drop the frames that have come so far: they are of earlier light."""
        for channel in (self._channel, self._heralds):
            with suppress(BlockingIOError):
                while True:
                    channel.recv(LONGEST)
        for kept in (self._begun, self._whole, self._last, self._heralded):
            kept.clear()
        self._held = b""

    async def next(self, pulses: int, analysers: int) -> Swapped:
        """Return the outcomes of the next block, of this size, at a number of analysers.

        Raise SessionError if they do not come, or the light has ended otherwise.
        """
        async with self._turn:
            try:
                async with asyncio.timeout(ANALYSER_TIMEOUT_S):
                    while len(self._there(pulses)) < analysers:
                        self._take(await self._next(self._channel, self._group), pulses)
                    found = {each: self._pop(each) for each in self._there(pulses)}
                    positions = await self._positions(pulses, found.values())
            except TimeoutError as error:
                text = (
                    f"no outcomes of {pulses} pulses from {analysers - len(self._there(pulses))} "
                    f"of {analysers} analysers in {ANALYSER_TIMEOUT_S:g} s: see that flow entries "
                    "lead light to both inputs of each, and its outcomes here, and that the "
                    "switches' agents run"
                )
                raise SessionError(Reason.NO_LIGHT, text) from error
        return _together(found, positions)

    def _there(self, pulses: int) -> list[bytes]:
        """Return the analysers that have reported the next block; drop what does not fit it.

        Only the session's own group hears of pulses that have met without gaps.
        """
        for reports in self._whole.values():
            while reports and (
                reports[0][0].pulses > pulses
                or (reports[0][0].pulses < pulses and not reports[0][1])
            ):
                reports.popleft()
        return [analyser for analyser, reports in self._whole.items() if reports]

    def _pop(self, analyser: bytes) -> AnalyserFrame:
        """Take the oldest report of an analyser; raise SessionError if one before it was lost."""
        frame, _own = self._whole[analyser].popleft()
        if frame.number != self._last.get(analyser, frame.number - 1) + 1:
            text = f"outcomes of block {frame.number} of an analyser come behind those of block "
            raise SessionError(Reason.PROTOCOL, f"{text}{self._last[analyser]}: some were lost")
        self._last[analyser] = frame.number
        return frame

    async def _positions(self, pulses: int, found: Iterable[AnalyserFrame]) -> NDArray[np.intp]:
        """Return which pulses of this end's light the memory at the other end of its link holds."""
        with suppress(BlockingIOError):
            while True:
                self._take_herald(self._heralds.recv(LONGEST))
        gaps = any(frame.pulses < pulses for frame in found)
        while gaps and not self._heralded:
            self._take_herald(await self._next(self._heralds, self._alone))
        held = self._heralded.popleft() if self._heralded else b""
        return np.flatnonzero(np.frombuffer(held, np.uint8) == 0) if gaps else np.arange(pulses)

    def _take_herald(self, data: bytes) -> None:
        """Take a frame of the memory that this end's light goes to; other frames do not count."""
        with suppress(MalformedPacket):
            frame = AnalyserFrame.decode(data)
            if data[:6] == self._alone and frame.first == len(self._held):
                self._held += frame.outcomes
                if len(self._held) == frame.pulses:
                    self._heralded.append(self._held)
                    self._held = b""

    def _take(self, data: bytes, pulses: int) -> None:
        """Take a frame; what is whole is kept. All of one block have its number, in order."""
        try:
            frame = AnalyserFrame.decode(data)
        except MalformedPacket:
            return
        analyser, own = data[6:12] + frame.port.to_bytes(4), data[:6] == self._group
        if frame.pulses > pulses and not own:
            return
        if frame.end != End.MEASURED:
            text = f"light has ended at inner port {frame.port} of a switch: "
            raise SessionError(Reason.NO_LIGHT, text + ENDS[frame.end])
        begun = self._begun.pop(analyser, None) if frame.first else None
        outcomes = begun.outcomes if begun and begun.number == frame.number else b""
        if frame.first == len(outcomes):
            whole = replace(frame, first=0, outcomes=outcomes + frame.outcomes)
            if len(whole.outcomes) < frame.pulses:
                self._begun[analyser] = whole
            else:
                self._whole[analyser].append((whole, own))

    async def _next(self, channel: socket.socket, group: bytes) -> bytes:
        """Return the next frame to everybody, to this host or to a group; drop those to others."""
        while True:
            data = await asyncio.get_running_loop().sock_recv(channel, LONGEST)
            if not data[0] & 1 or data[:6] in (BROADCAST, group):
                return data


def _together(found: dict[bytes, AnalyserFrame], positions: NDArray[np.intp]) -> Swapped:
    """Return what the i-th pulses of all blocks make, as many as the poorest block has."""
    most = min(frame.pulses for frame in found.values())
    each = np.array([np.frombuffer(frame.outcomes, np.uint8)[:most] for frame in found.values()])
    product = np.bitwise_xor.reduce(each)
    product[(each == NO_COINCIDENCE).any(axis=0)] = NO_COINCIDENCE
    numbers = sorted((crc32(analyser), frame.number) for analyser, frame in found.items())
    waited_us = {
        analyser[PLACE]: frame.waited_us
        for analyser, frame in found.items()
        if analyser.startswith(PLACES)
    }
    blocks = [word for pair in numbers for word in pair]
    return Swapped(product, positions[:most], blocks, waited_us)


@contextmanager
def analyser_socket(session: int, to: Receivers) -> Iterator[AnalyserSocket]:
    """Give what takes frames of analysers and memories at all interfaces of a session's end."""
    with _socket(ETHER_TYPE) as outcomes, _socket(HERALDS) as heralds:
        yield AnalyserSocket(outcomes, heralds, session, to)


def _socket(kind: bytes) -> socket.socket:
    protocol = socket.htons(int.from_bytes(kind, "big"))
    channel = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, protocol)
    channel.setblocking(False)
    return channel
