"""Frames of switches' Bell analysers, as they come to a host's copper."""

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from hosts.middleware.session.errors import SessionError
from hosts.timeouts import ANALYSER_TIMEOUT_S
from wire.analyser_frames import (
    BROADCAST,
    ETHER_TYPE,
    ETHERNET_BYTES,
    MOST_PAYLOAD,
    AnalyserFrame,
    End,
    group_of,
)
from wire.malformed import MalformedPacket
from wire.metadata.vocabulary import Reason
from wire.outcomes import NO_COINCIDENCE

LONGEST = ETHERNET_BYTES + MOST_PAYLOAD
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

    outcomes: bytes  # for each pulse the product of all, NO_COINCIDENCE if one has none
    blocks: list[int]  # which analysers, and their numbers of the block, alike at both ends


class AnalyserSocket:
    """Reads the outcomes that analysers report, block by block."""

    def __init__(self, channel: socket.socket, session: int) -> None:
        self._channel, self._group = channel, group_of(session)
        self._begun: dict[bytes, AnalyserFrame] = {}  # of each analyser, what is not whole yet

    def forget(self) -> None:
        """Drop the frames that have come so far: they are of earlier light."""
        with suppress(BlockingIOError):
            while True:
                self._channel.recv(LONGEST)

    async def next(self, pulses: int, analysers: int) -> Swapped:
        """Return the outcomes of the next block of this size at a number of analysers.

        Raise SessionError if they do not come, or the light has ended otherwise.
        """
        found: dict[bytes, AnalyserFrame] = {}
        try:
            async with asyncio.timeout(ANALYSER_TIMEOUT_S):
                while len(found) < analysers:
                    await self._join(found, pulses)
        except TimeoutError as error:
            text = (
                f"no outcomes of {pulses} pulses from {analysers - len(found)} of {analysers} "
                f"analysers in {ANALYSER_TIMEOUT_S:g} s: see that flow entries lead light to both "
                "inputs of each, and its outcomes here, and that the switches' agents run"
            )
            raise SessionError(Reason.NO_LIGHT, text) from error
        return _together(found)

    async def _join(self, found: dict[bytes, AnalyserFrame], pulses: int) -> None:
        """Take a frame; what is whole is found. All of one block have its number, in order."""
        analyser, frame = await self._frame()
        if frame.pulses != pulses:
            return
        if frame.end != End.MEASURED:
            text = f"light has ended at inner port {frame.port} of a switch: "
            raise SessionError(Reason.NO_LIGHT, text + ENDS[frame.end])
        begun = self._begun.pop(analyser, None) if frame.first else None
        outcomes = begun.outcomes if begun and begun.number == frame.number else b""
        if frame.first == len(outcomes):
            whole = replace(frame, first=0, outcomes=outcomes + frame.outcomes)
            (found if len(whole.outcomes) == pulses else self._begun)[analyser] = whole

    async def _frame(self) -> tuple[bytes, AnalyserFrame]:
        """Return the next frame, and which analyser's; other bytes are dropped."""
        while True:
            data = await asyncio.get_running_loop().sock_recv(self._channel, LONGEST)
            if data[0] & 1 and data[:6] not in (BROADCAST, self._group):
                continue  # of another session
            with suppress(MalformedPacket):
                frame = AnalyserFrame.decode(data)
                return data[6:12] + frame.port.to_bytes(4), frame


def _together(found: dict[bytes, AnalyserFrame]) -> Swapped:
    each = np.array([np.frombuffer(frame.outcomes, np.uint8) for frame in found.values()])
    product = np.bitwise_xor.reduce(each)
    product[(each == NO_COINCIDENCE).any(axis=0)] = NO_COINCIDENCE
    numbers = sorted((crc32(analyser), frame.number) for analyser, frame in found.items())
    return Swapped(product.tobytes(), [word for pair in numbers for word in pair])


@contextmanager
def analyser_socket(session: int) -> Iterator[AnalyserSocket]:
    """Give a socket that takes the frames of analysers at all interfaces of this host."""
    protocol = socket.htons(int.from_bytes(ETHER_TYPE, "big"))
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, protocol) as channel:
        channel.setblocking(False)
        yield AnalyserSocket(channel, session)
