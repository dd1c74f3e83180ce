"""The processing unit of a host: serves applications at the host's socket, each by itself.

An application says PROCESS, hears which nodes exist, and then sends NetQASM's own messages
(applications.processing_unit.messages), one by one; each is answered when it has been dealt with.
"""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from applications.processing_unit.application import Application
from applications.processing_unit.messages import (
    Finished,
    HostMessage,
    InitApplication,
    OpenSocket,
    StopApplication,
    UnitMessage,
    decode_host_message,
    encode_unit_message,
)
from applications.processing_unit.pair_requests import PAIRS_PORT
from applications.processing_unit.pairs import PairService
from applications.processing_unit.subroutine import Subroutine
from hosts.hardware.qnic import Qnic
from hosts.middleware.session.errors import SessionError, unsupported
from hosts.serving.opened_session import read_call, reply, stopped, unless_gone
from hosts.serving.processing import Sessions
from wire.config import HostConfig
from wire.metadata.vocabulary import Reason
from wire.socket_calls import Call, encode, encode_fields


class Unit:
    port = PAIRS_PORT

    def __init__(
        self, config: HostConfig, qnic: Qnic, sessions: Sessions, new_session: Callable[[], int]
    ) -> None:
        """Sessions are opened and accepted by the host's stack, which also numbers them."""
        self._name, self._seed, self._qnic = config.name, config.seed, qnic
        self._nodes: Mapping[str, str] = dict(sorted(config.hosts.items()))
        self._new_session = new_session
        self._pairs = PairService(config, self._nodes, qnic, sessions)
        self.serve_unit = self._pairs.serve

    async def serve_application(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Send an application the addresses of all nodes, then do what it requests."""
        connection = Connection(self._begin)
        coming = asyncio.create_task(read_call(reader))
        try:
            writer.write(encode_fields(Call.DONE, node=self._name, nodes=self._nodes))
            while True:
                call, payload = await coming
                if call == Call.CLOSE:
                    break
                if call not in (Call.DATA, Call.ASK):
                    raise SessionError(Reason.PROTOCOL, f"{call.name} to a processing unit")
                coming = asyncio.create_task(read_call(reader))
                work = _handle if call == Call.DATA else _answer
                await unless_gone(work(connection, payload, writer), coming)
        finally:
            await stopped(coming)
            await connection.close()
        writer.write(encode_fields(Call.CLOSE))

    def _begin(self, message: InitApplication) -> Application:
        session = self._new_session()
        draws = np.random.default_rng([self._seed, session, *self._name.encode()])
        nodes = list(self._nodes)
        return Application(nodes, self._qnic, self._pairs, session, message.qubits, draws)


class Connection:
    def __init__(self, begin: Callable[[InitApplication], Application]) -> None:
        self._begin = begin
        self._application: Application | None = None
        self._number = self._messages = 0

    async def handle(self, message: HostMessage) -> list[UnitMessage]:
        """Do what a message says; return what is answered. Raise SessionError if it cannot be."""
        answers: list[UnitMessage] = []
        match message:
            case InitApplication(number):
                if self._application is not None:
                    raise SessionError(Reason.PROTOCOL, "an application has begun here already")
                self._number, self._application = number, self._begin(message)
            case OpenSocket():
                self._begun(message.application).open_socket(message)
            case Subroutine():
                answers += await self._begun(message.application).run(message)
            case StopApplication(number):
                self._begun(number)
                await self.close()
        answers.append(Finished(self._messages))
        self._messages += 1
        return answers

    async def answer(self, question: dict[str, Any]) -> dict[str, Any]:
        """Tell the state of a qubit, where states are simulated: {"look": number, "entangled"}.

        Return the parts of its density matrix: {"real": rows, "imaginary": rows}.
        """
        if self._application is None:
            raise SessionError(Reason.PROTOCOL, "no application has begun on this connection")
        qubit, entangled = question.get("look"), question.get("entangled")
        if question.keys() != {"look", "entangled"} or not isinstance(entangled, bool):
            raise unsupported("ask to look at a qubit, entangled or not")
        if not isinstance(qubit, int):
            raise unsupported(f"qubit {qubit!r} is not a number")
        matrix = await self._application.look(qubit, entangled)
        return {"real": matrix.real.tolist(), "imaginary": matrix.imag.tolist()}

    async def close(self) -> None:
        application, self._application = self._application, None
        if application is not None:
            await asyncio.shield(application.close())

    def _begun(self, number: int) -> Application:
        if self._application is None or number != self._number:
            text = f"application {number} has not begun on this connection"
            raise SessionError(Reason.PROTOCOL, text)
        return self._application


async def _handle(connection: Connection, payload: bytes, writer: asyncio.StreamWriter) -> None:
    for answer in await connection.handle(decode_host_message(payload)):
        writer.write(encode(Call.DATA, encode_unit_message(answer)))
        await writer.drain()


async def _answer(connection: Connection, question: bytes, writer: asyncio.StreamWriter) -> None:
    writer.write(await reply(connection.answer, question))
    await writer.drain()
