"""Frames of switches' Bell analysers, as they come to a host's copper."""

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from hosts.middleware.session.errors import SessionError
from hosts.timeouts import ANALYSER_TIMEOUT_S
from wire.analyser_frames import ETHER_TYPE, ETHERNET_BYTES, MOST_PAYLOAD, AnalyserFrame, End
from wire.malformed import MalformedPacket
from wire.metadata.vocabulary import Reason

LONGEST = ETHERNET_BYTES + MOST_PAYLOAD
ENDS = {
    End.NO_PARTNER: "the other end's light did not come in time",
    End.CLOSED: "its flow entry ended while it waited there",
    End.UNFIT: "it does not fit the other end's (size, encoding), or the part of the switch",
    End.CUT_OFF: "nothing released it from the memory there in time",
}


class AnalyserSocket:
    """Reads the outcomes that analysers report, block by block."""

    def __init__(self, channel: socket.socket) -> None:
        self._channel = channel

    def forget(self) -> None:
        """Drop the frames that have come so far: they are of earlier light."""
        with suppress(BlockingIOError):
            while True:
                self._channel.recv(LONGEST)

    async def next(self, pulses: int) -> AnalyserFrame:
        """Return the outcomes of the next block of this size.

        Raise SessionError if they do not come, or the light has ended otherwise.
        """
        try:
            async with asyncio.timeout(ANALYSER_TIMEOUT_S):
                return await self._whole(pulses)
        except TimeoutError as error:
            text = (
                f"no outcomes of {pulses} pulses from a switch in {ANALYSER_TIMEOUT_S:g} s: see "
                "that flow entries lead the light of both ends to the inputs of one analyser, and "
                "its outcomes here, and that the switch's agent runs"
            )
            raise SessionError(Reason.NO_LIGHT, text) from error

    async def _whole(self, pulses: int) -> AnalyserFrame:
        """Join the frames of a block; all of one block have its number, and come in order."""
        outcomes, begun = b"", (0, 0)
        while len(outcomes) < pulses:
            frame = await self._frame()
            if frame.pulses != pulses:
                continue
            if frame.end != End.MEASURED:
                text = f"light has ended at inner port {frame.port} of a switch: "
                raise SessionError(Reason.NO_LIGHT, text + ENDS[frame.end])
            if not frame.first:
                outcomes, begun = b"", (frame.port, frame.number)
            if (frame.port, frame.number) == begun and frame.first == len(outcomes):
                outcomes += frame.outcomes
        return AnalyserFrame(*begun, End.MEASURED, pulses, 0, outcomes)

    async def _frame(self) -> AnalyserFrame:
        """Return the next frame; bytes that are none are dropped."""
        while True:
            data = await asyncio.get_running_loop().sock_recv(self._channel, LONGEST)
            with suppress(MalformedPacket):
                return AnalyserFrame.decode(data)


@contextmanager
def analyser_socket() -> Iterator[AnalyserSocket]:
    """Give a socket that takes the frames of analysers at all interfaces of this host."""
    protocol = socket.htons(int.from_bytes(ETHER_TYPE, "big"))
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, protocol) as channel:
        channel.setblocking(False)
        yield AnalyserSocket(channel)
