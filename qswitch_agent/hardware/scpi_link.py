"""A TCP connection to an instrument that speaks SCPI: a line out, a line back.

SCPI-99 volume 1 (error queue, `:SYSTem:ERRor?`) and IEEE 488.2 (`*CLS`, `*IDN?`, `*OPC?`).
Each request is followed by `:syst:err?`, so that one that is refused, and therefore has no
answer, is told from one that is slow.
"""

import asyncio
import string

from qswitch_agent.hardware.optics import HardwareRefusal
from qswitch_agent.hardware.scpi_format import GarbledReply, is_error, read_error

LINE_LIMIT = 1 << 16
MAX_ERRORS = 32  # in the instrument's queue
ERROR_QUERY = ":syst:err?"


class ScpiLink:
    """Requests one after the other; the caller sees to it that they do not overlap.

    A request raises HardwareRefusal if the instrument refuses it, and OSError, EOFError or
    GarbledReply if nothing more can be asked on this connection.
    """

    def __init__(self, host: str, port: int) -> None:
        """Name the instrument's address; nothing is connected yet."""
        self._host, self._port = host, port
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None
        self.identity = ""

    async def open(self) -> None:
        """Connect, unless that is done; forget old errors and learn who answers."""
        if self._streams is None:
            self._streams = await asyncio.open_connection(self._host, self._port, limit=LINE_LIMIT)
            self._write("*CLS")
            self.identity = await self.query("*IDN?")

    async def query(self, text: str) -> str:
        self._write(text, ERROR_QUERY)
        answer = await self._line()
        if is_error(answer):
            await self._refuse(answer, text)
            raise GarbledReply(f"answers to {text}", answer)
        await self._refuse(await self._line(), text)
        return answer

    async def command(self, text: str) -> None:
        """Have something done; return once it is."""
        self._write(text, "*OPC?", ERROR_QUERY)
        done = await self._line()
        if done != "1":
            raise GarbledReply("answers to *OPC?", done)
        await self._refuse(await self._line(), text)

    def drop(self) -> None:
        """End the connection without a word."""
        if self._streams is not None:
            self._streams[1].close()

    async def close(self) -> None:
        """End the connection and wait until it has ended."""
        if self._streams is not None:
            self.drop()
            await asyncio.gather(self._streams[1].wait_closed(), return_exceptions=True)

    async def _refuse(self, line: str, text: str) -> None:
        """Raise HardwareRefusal if a line tells of an error; read those that follow it, too."""
        number, message = read_error(line)
        if number == 0:
            return
        for _ in range(MAX_ERRORS):
            self._write(ERROR_QUERY)
            if read_error(await self._line())[0] == 0:
                raise HardwareRefusal(f"{text}: error {number}, {message}")
        raise GarbledReply("ends of the errors", line)

    def _write(self, *lines: str) -> None:
        assert self._streams is not None
        self._streams[1].write("".join(f"{line}\n" for line in lines).encode("ascii"))

    async def _line(self) -> str:
        assert self._streams is not None
        try:
            line = await self._streams[0].readuntil(b"\n")
        except asyncio.LimitOverrunError as error:
            raise GarbledReply(f"lines of at most {LINE_LIMIT} bytes", "") from error
        try:
            return line.decode("ascii").strip(string.whitespace)
        except UnicodeDecodeError as error:
            raise GarbledReply("ASCII characters", repr(line)) from error
