"""A small matrix switch that speaks SCPI over TCP on loopback; a program for tests.

python scpi_instrument.py --size 8: ingress ports 1 to 8, egress ports 9 to 16. It prints its
TCP port. Besides the commands of such switches it knows, for tests alone:

    :test:settle SECONDS     what a change of connections takes
    :test:fail (@3)          these ports fail: their connections cannot be changed any more
    :test:say TEXT           the next answer is this text; \\n ends a line, \\xff is no ASCII
    :test:mute N             the N-th next query and all after it get no answer
    :test:without PREFIX     the instrument knows no command that begins like this
    :test:log?               the commands that changed connections, separated by |
"""

import argparse
import asyncio
import re
from collections.abc import Callable

NO_ERROR = '0,"No error"'
CHANNELS = re.compile(r"\(@([\d,]*)\)")


class ScpiError(Exception):
    """An entry of the error queue."""


class Instrument:
    """The matrix, and how it shall misbehave."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.connections: dict[int, int] = {}
        self.failed: set[int] = set()
        self.log: list[str] = []
        self.settle_s = 0.0
        self.settled_s = 0.0
        self.replies: list[str] = []
        self.answers_left: int | None = None
        self.without: list[str] = []

    def lists(self, argument: str, count: int) -> list[list[int]]:
        """Return the channel lists of an argument; they must have the same length."""
        found = [[int(n) for n in text.split(",") if n] for text in CHANNELS.findall(argument)]
        if len(found) != count or len({len(one) for one in found}) != 1:
            raise ScpiError('-220,"Parameter error"')
        for port in (port for one in found for port in one):
            if not 1 <= port <= 2 * self.size:
                raise ScpiError('-222,"Data out of range"')
        return found

    def pairs(self, argument: str) -> dict[int, int]:
        """Return the connections that an argument names."""
        ingress, egress = self.lists(argument, 2)
        if any(port > self.size for port in ingress) or any(port <= self.size for port in egress):
            raise ScpiError('-222,"Data out of range"')
        if self.failed & {*ingress, *egress}:
            raise ScpiError('-240,"Hardware error; port failed"')
        return dict(zip(ingress, egress, strict=True))

    def add(self, argument: str) -> None:
        pairs = self.pairs(argument)
        taken = {*self.connections, *self.connections.values()} & {*pairs, *pairs.values()}
        if taken:
            raise ScpiError('-221,"Settings conflict; port in use"')
        self.connections |= pairs
        self._changed(f"add {argument}")

    def sub(self, argument: str) -> None:
        pairs = self.pairs(argument)
        if not pairs.items() <= self.connections.items():
            raise ScpiError('-221,"Settings conflict; not connected"')
        for ingress in pairs:
            del self.connections[ingress]
        self._changed(f"sub {argument}")

    def _changed(self, text: str) -> None:
        self.log.append(text)
        self.settled_s = asyncio.get_running_loop().time() + self.settle_s

    def states(self, argument: str) -> str:
        (ports,) = self.lists(argument, 1)
        return f"({','.join('F' if port in self.failed else 'E' for port in ports)})"

    def powers(self, argument: str) -> str:
        (ports,) = self.lists(argument, 1)
        return f"({','.join(f'{-port:.2f}' for port in ports)})"

    def all_connections(self, _argument: str) -> str:
        made = sorted(self.connections.items())
        sides = (",".join(str(pair[side]) for pair in made) for side in (0, 1))
        return ",".join(f"(@{side})" for side in sides)

    def mute(self, argument: str) -> None:
        self.answers_left = int(argument)

    def say(self, argument: str) -> None:
        self.replies.append(argument.replace("\\n", "\n").replace("\\xff", "\xff"))

    def settle(self, argument: str) -> None:
        self.settle_s = float(argument)

    def fail(self, argument: str) -> None:
        self.failed = set(self.lists(argument, 1)[0])


class Session:
    """One client's connection, with an error queue of its own."""

    def __init__(self, instrument: Instrument, writer: asyncio.StreamWriter) -> None:
        self._instrument, self._writer = instrument, writer
        self._errors: list[str] = []
        queries: dict[str, Callable[[str], str]] = {
            "*idn?": lambda _: "qmn tests,MATRIX,1,1.0",
            ":syst:err?": lambda _: self._errors.pop(0) if self._errors else NO_ERROR,
            ":oxc:swit:size?": lambda _: f"{instrument.size},{instrument.size}",
            ":oxc:swit:conn:stat?": instrument.all_connections,
            ":oxc:swit:port:stat?": instrument.states,
            ":pmon:pow?": instrument.powers,
            ":test:log?": lambda _: "|".join(instrument.log) or "none",
        }
        commands: dict[str, Callable[[str], object]] = {
            "*cls": lambda _: self._errors.clear(),
            ":oxc:swit:conn:add": instrument.add,
            ":oxc:swit:conn:sub": instrument.sub,
            ":oxc:swit:disc:all": lambda _: instrument.connections.clear(),
            ":test:settle": instrument.settle,
            ":test:fail": instrument.fail,
            ":test:say": instrument.say,
            ":test:mute": instrument.mute,
            ":test:without": instrument.without.append,
        }
        self._queries, self._commands = queries, commands

    async def take(self, line: str) -> None:
        """Do one command or answer one query."""
        name, _space, argument = line.strip().partition(" ")
        name, instrument = name.lower(), self._instrument
        test = name.startswith(":test")
        try:
            if name == "*opc?":
                now_s = asyncio.get_running_loop().time()
                await asyncio.sleep(max(instrument.settled_s - now_s, 0))
                self._answer("1", test)
            elif any(name.startswith(prefix) for prefix in instrument.without):
                raise ScpiError('-113,"Undefined header"')
            elif name in self._queries:
                self._answer(self._queries[name](argument), test)
            elif name in self._commands:
                self._commands[name](argument)
            else:
                raise ScpiError('-113,"Undefined header"')
        except ScpiError as error:
            self._errors.append(str(error))

    def _answer(self, text: str, test: bool) -> None:
        instrument = self._instrument
        if not test and instrument.answers_left is not None:
            instrument.answers_left -= 1
            if instrument.answers_left < 0:
                return
        if instrument.replies and not test:
            text = instrument.replies.pop(0)
        self._writer.write(f"{text}\n".encode("latin-1"))


async def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--size", type=int, default=8)
    instrument = Instrument(parser.parse_args().size)

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        session = Session(instrument, writer)
        while line := await reader.readline():
            await session.take(line.decode("ascii"))
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    print(server.sockets[0].getsockname()[1], flush=True)
    await server.serve_forever()


if __name__ == "__main__":
    asyncio.run(main())
