"""The agreement of two processing units on pairs, at the end that creates them."""

import asyncio

from applications.processing_unit.pair_requests import (
    ANSWER,
    PAIRS_PORT,
    PairRequest,
    PairsMade,
    Verdict,
    decode_answer,
    decode_made,
)
from applications.timeouts import WANTED_TIMEOUT_S
from hosts.middleware.session.errors import SessionError, unsupported
from hosts.timeouts import ANSWER_TIMEOUT_S, CONNECT_TIMEOUT_S, REPORT_TIMEOUT_S
from wire.malformed import MalformedPacket
from wire.metadata.vocabulary import Reason

REFUSALS = {
    Verdict.NOBODY: f"has not asked to receive them in {WANTED_TIMEOUT_S:g} s: does its program "
    "open the same sockets, receive as many pairs, and does it still run?",
    Verdict.OTHER_USE: "has named no qubits to keep them in: let both ends use them alike",
}


class Agreement:
    """The connection to another unit, as long as it is to know that pairs come."""

    port = pairs = 0  # where they may come, and how many; from the answer

    def __init__(self, request: PairRequest, remote: str, address: str) -> None:
        self._request, self._remote, self._address = request, remote, address
        self._writer: asyncio.StreamWriter | None = None

    async def __aenter__(self) -> "Agreement":
        """Ask for pairs; return when some are wanted there."""
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT_S):
                reader, self._writer = await asyncio.open_connection(self._address, PAIRS_PORT)
        except OSError as error:  # TimeoutError is one
            raise SessionError(
                Reason.NO_ANSWER,
                f"the processing unit of {self._remote} ({self._address}) does not answer on port "
                f"{PAIRS_PORT} ({str(error) or f'nothing in {CONNECT_TIMEOUT_S:g} s'}); is it up?",
            ) from error
        self._writer.write(self._request.encode())
        try:
            async with asyncio.timeout(WANTED_TIMEOUT_S + ANSWER_TIMEOUT_S):
                answer = decode_answer(await reader.readexactly(ANSWER.size))
        except (OSError, asyncio.IncompleteReadError, MalformedPacket) as error:
            self._writer.close()
            text = (
                f"the processing unit of {self._remote} has not answered: {str(error) or 'timeout'}"
            )
            raise SessionError(_reason_of(error), text) from error
        subject = f"{self._request.pairs} pairs with {self._remote}: the other end"
        if answer.verdict != Verdict.READY:
            self._writer.close()
            raise unsupported(f"{subject} {REFUSALS[answer.verdict]}")
        if answer.pairs > self._request.pairs:
            self._writer.close()
            raise SessionError(Reason.PROTOCOL, f"{subject} accepts {answer.pairs}")
        self.port, self.pairs = answer.port, answer.pairs
        return self

    def report(self, light_us: int) -> None:
        assert self._writer is not None
        self._writer.write(PairsMade(light_us).encode())

    async def __aexit__(self, *_exception: object) -> None:
        assert self._writer is not None
        self._writer.close()


async def reported_light_us(end: "asyncio.Task[bytes]") -> int:
    try:
        async with asyncio.timeout(REPORT_TIMEOUT_S):
            return decode_made(await asyncio.shield(end)).light_us
    except (OSError, asyncio.IncompleteReadError, MalformedPacket) as error:
        text = f"the creator of pairs has not reported them: {str(error) or 'timeout'}"
        raise SessionError(_reason_of(error), text) from error


def _reason_of(error: Exception) -> Reason:
    if isinstance(error, MalformedPacket):
        return Reason.PROTOCOL
    return Reason.NO_ANSWER if isinstance(error, TimeoutError) else Reason.PEER_GONE
