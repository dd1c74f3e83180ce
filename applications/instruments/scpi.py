"""A matrix switch that understands SCPI over TCP, as laboratories own them.

The commands are those of Polatis switches (their SCPI manual is PROD-B-100-03; not at hand,
so they were taken from published programs that drive such switches, for example
devicecontrol-polatis of the University of Bristol's HPN group):

    :oxc:swit:conn:add (@1,2),(@17,18)   connect ingress 1 to egress 17 and 2 to 18
    :oxc:swit:conn:sub (@1,2),(@17,18)   disconnect them
    :oxc:swit:conn:stat?                 all connections, of all users of the instrument
    :oxc:swit:port:stat? (@1,17)         E enabled, D disabled, F failed; not on every model
    :pmon:pow? (@1,17)                   optical power monitors; not on every model

Such a switch passes light unchanged. It has no filters and counts no photons: ports cannot
be tuned, circuits always read 0 photons, and an idle time-out cannot be judged by it. Its
insertion loss is not known to it. Variable attenuators of some models are not used.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterable, Mapping
from typing import NamedTuple, TypeVar
from urllib.parse import urlsplit

from applications.instruments import scpi_link
from applications.instruments.scpi_link import GarbledReply, ScpiLink
from applications.timeouts import SCPI_POLL_S
from qswitch_agent.hardware.optics import (
    CircuitReading,
    Condition,
    CrossConnect,
    Direction,
    HardwareFault,
    HardwareRefusal,
    PortReading,
    Quantity,
    Readings,
)
from qswitch_agent.timeouts import CALL_DEADLINE_S
from wire.analyser_frames import AnalyserFrame, Emission
from wire.config import AgentConfig, BadConfig

SCPI_PORT = 5025  # registered with IANA as scpi-raw
NEVER_MEASURED = frozenset(
    {Quantity.PHOTONS, Quantity.FREQUENCY, Quantity.BIAS, Quantity.TEMPERATURE}
)

Answer = TypeVar("Answer")


class MatrixPort(NamedTuple):
    ingress: int  # for light that comes from the fibre
    egress: int  # for light that goes into it


class ScpiSwitch:
    """The cross-connects of some ports of a matrix switch; those of others are left alone."""

    def __init__(self, host: str, port: int, ports: Mapping[int, MatrixPort]) -> None:
        """Name the instrument's address, and its numbers for each OpenFlow port."""
        self._address = f"{host}:{port}"
        self._link = ScpiLink(host, port)
        self._ports = dict(ports)
        self._by_ingress = {numbers.ingress: port for port, numbers in ports.items()}
        self._by_egress = {numbers.egress: port for port, numbers in ports.items()}
        self._turn = asyncio.Lock()
        self._calls: set[asyncio.Task[object]] = set()
        self._fault: HardwareFault | None = None
        self._made: dict[int, int] | None = None  # by us, ingress to egress
        self._since_ns: dict[int, int] = {}  # of circuits
        self._unsupported: set[str] = set()  # queries that the instrument does not know

    async def set_cross_connects(self, cross_connects: Iterable[CrossConnect]) -> None:
        """Make exactly these cross-connects; return when the instrument has settled.

        Light that is to pass as before is not touched. The others are first disconnected
        and then connected, with one command each.
        """
        requested = list(cross_connects)
        connections = self._connections(requested)

        async def change() -> None:
            await self._change(connections)
            numbers = {one.circuit for one in requested}
            now_ns = time.time_ns()
            self._since_ns = {number: self._since_ns.get(number, now_ns) for number in numbers}

        await self._call(change)

    async def tune(
        self,
        port: int,
        frequency_mhz: int | None,
        power_dbm: float | None,
        direction: Direction = Direction.BOTH,
        cutoff_s: float | None = None,
    ) -> None:
        """Refuse: a matrix switch passes light of every wavelength as it is."""
        raise HardwareRefusal(f"port {port} cannot be tuned: a matrix switch has no filters")

    async def read(self) -> Readings:
        """Return the monitors' powers, and circuits without their photons."""
        return await self._call(self._read)

    async def watch_analysers(self, on_report: Callable[[AnalyserFrame], None]) -> None:
        """Refuse: mirrors measure nothing."""
        raise HardwareRefusal(f"{self._link.identity} has no Bell analysers")

    async def emit(self, port: int, emission: Emission) -> None:
        """Refuse: mirrors make no light."""
        raise HardwareRefusal(f"{self._link.identity} has no source of pairs at port {port}")

    async def keep(self, chosen: AnalyserFrame) -> None:
        """Refuse: mirrors store no light."""
        raise HardwareRefusal(f"{self._link.identity} has no memory at port {chosen.port}")

    async def watch(self, on_condition: Callable[[Condition], None]) -> None:
        """Report the condition at once and after each change; raise HardwareFault at the end.

        Every SCPI_POLL_S the instrument is asked for its connections and its ports' states. A
        connection of a port that has failed is stuck. Connections of our ports that others
        have changed are a fault.
        """
        reported = None
        while True:
            condition = await self._call(self._condition)
            if condition != reported:
                on_condition(condition)
                reported = condition
            await asyncio.sleep(SCPI_POLL_S)

    async def close(self) -> None:
        """Close the connection; what is in progress is given up."""
        for call in self._calls:
            call.cancel()
        await asyncio.gather(*self._calls, return_exceptions=True)
        await self._link.close()

    async def _call(self, work: Callable[[], Awaitable[Answer]]) -> Answer:
        """Do work when it is its turn; it is finished even if the caller no longer waits.

        To leave a request half-way would take its answer for that of the next.
        """
        call = asyncio.create_task(self._in_turn(work))
        self._calls.add(call)
        call.add_done_callback(self._ended)
        return await asyncio.shield(call)

    def _ended(self, call: "asyncio.Task[Answer]") -> None:
        self._calls.discard(call)
        if not call.cancelled():
            call.exception()  # a caller that still waits gets it

    async def _in_turn(self, work: Callable[[], Awaitable[Answer]]) -> Answer:
        try:
            async with asyncio.timeout(CALL_DEADLINE_S), self._turn:
                if self._fault is not None:
                    raise self._fault
                await self._link.open()
                return await work()
        except TimeoutError:
            cause = f"no answer within {CALL_DEADLINE_S:g} s"
        except (OSError, EOFError) as error:
            lost = "the connection is lost" if self._link.identity else "cannot be reached"
            cause = f"{lost} ({error})"
        except GarbledReply as error:
            cause = f"garbled reply: {error}"
        self._link.drop()
        self._fault = HardwareFault(
            f"matrix switch at {self._address}: {cause}; see to the instrument, then start the "
            "agent again"
        )
        raise self._fault

    def _connections(self, cross_connects: Iterable[CrossConnect]) -> dict[int, int]:
        """Return ingress to egress; refuse ports that are unknown or asked for twice."""
        connections: dict[int, int] = {}
        for in_port, out_port, _circuit in sorted(cross_connects):
            for port in (in_port, out_port):
                if port not in self._ports:
                    ports = ", ".join(map(str, sorted(self._ports)))
                    raise HardwareRefusal(f"port {port} is not at the instrument, but {ports} are")
            ingress, egress = self._ports[in_port].ingress, self._ports[out_port].egress
            if ingress in connections or egress in connections.values():
                raise HardwareRefusal(f"{in_port} -> {out_port}: one of the ports is used twice")
            connections[ingress] = egress
        return connections

    async def _change(self, connections: dict[int, int]) -> None:
        before = await self._ours()
        try:
            await self._replace(before, connections)
        except HardwareRefusal:
            await self._restore(before)
            raise
        if (actual := await self._ours()) != connections:
            raise GarbledReply(f"connections that were made ({connections})", str(actual))
        self._made = connections

    async def _restore(self, before: dict[int, int]) -> None:
        """Go back to what was; what the instrument refuses, too, is a fault."""
        try:
            await self._replace(await self._ours(), before)
        except HardwareRefusal as error:
            raise GarbledReply(f"connections it had before ({error})", str(before)) from error
        self._made = before

    async def _replace(self, before: dict[int, int], after: dict[int, int]) -> None:
        removed = {i: e for i, e in before.items() if after.get(i) != e}
        added = {i: e for i, e in after.items() if before.get(i) != e}
        for verb, connections in (("sub", removed), ("add", added)):
            if connections:
                await self._link.command(f":oxc:swit:conn:{verb} {scpi_link.pairs(connections)}")

    async def _ours(self) -> dict[int, int]:
        connections = scpi_link.read_connections(await self._link.query(":oxc:swit:conn:stat?"))
        return {
            ingress: egress
            for ingress, egress in connections.items()
            if ingress in self._by_ingress or egress in self._by_egress
        }

    async def _condition(self) -> Condition:
        connections = await self._ours()
        if self._made is not None and connections != self._made:
            raise HardwareFault(
                f"matrix switch at {self._address}: somebody else has changed its connections "
                f"to {scpi_link.pairs(connections)}; start the agent again to make its own"
            )
        failed = await self._failed_ports()
        stuck = {
            (self._by_ingress[ingress], self._by_egress[egress])
            for ingress, egress in connections.items()
            if failed & {ingress, egress}
            if ingress in self._by_ingress and egress in self._by_egress
        }
        return Condition(stuck=frozenset(stuck))

    async def _failed_ports(self) -> set[int]:
        numbers = [*self._by_ingress, *self._by_egress]
        answer = await self._optional(f":oxc:swit:port:stat? {scpi_link.channels(numbers)}")
        if answer is None:
            return set()
        states = scpi_link.read_states(answer, len(numbers))
        return {number for number, state in zip(numbers, states, strict=True) if state == "F"}

    async def _read(self) -> Readings:
        received = await self._powers(self._by_ingress)
        sent = await self._powers(self._by_egress)
        not_measured = set(NEVER_MEASURED)
        not_measured |= set() if received else {Quantity.RX_POWER}
        not_measured |= set() if sent else {Quantity.TX_POWER}
        return Readings(
            ports={
                port: PortReading(tx_dbm=sent.get(port), rx_dbm=received.get(port))
                for port in self._ports
            },
            circuits={
                number: CircuitReading(0, since_ns, since_ns)
                for number, since_ns in self._since_ns.items()
            },
            not_measured=frozenset(not_measured),
        )

    async def _powers(self, numbers: Mapping[int, int]) -> dict[int, float]:
        """Return the power in dBm by OpenFlow port, empty where no monitors are."""
        answer = await self._optional(f":pmon:pow? {scpi_link.channels(numbers)}")
        if answer is None:
            return {}
        powers = scpi_link.read_powers(answer, len(numbers))
        return dict(zip(numbers.values(), powers, strict=True))

    async def _optional(self, query: str) -> str | None:
        """Return the answer to a query, None if the instrument refuses it, now or earlier."""
        if query in self._unsupported:
            return None
        try:
            return await self._link.query(query)
        except HardwareRefusal:
            self._unsupported.add(query)
            return None


def instrument(config: AgentConfig) -> ScpiSwitch:
    """Return the driver that a configuration asks for; raise BadConfig if there is none."""
    host, port = _address(config.hardware)
    return ScpiSwitch(host, port, _matrix_ports(config))


def _address(url: str) -> tuple[str, int]:
    try:
        parts = urlsplit(url)
        port = SCPI_PORT if parts.port is None else parts.port
    except ValueError as error:
        raise BadConfig(f"hardware {url!r}: {error}") from error
    extra = parts.path or parts.query or parts.fragment or parts.username
    if parts.scheme != "scpi" or not parts.hostname or not port or extra:
        raise BadConfig(f"hardware {url!r} is not known; write scpi://HOST:PORT")
    return parts.hostname, port


def _matrix_ports(config: AgentConfig) -> dict[int, MatrixPort]:
    ports: dict[int, MatrixPort] = {}
    used: set[int] = set()
    for port in config.fiber_ports:
        numbers = config.hardware_ports.get(str(port))
        if not isinstance(numbers, list) or len(numbers) != 2 or not all(map(_is_port, numbers)):
            raise BadConfig(
                f"hardware_ports of fibre port {port} are {numbers!r}; name the instrument's "
                "numbers, as in [1, 17] for ingress 1 and egress 17"
            )
        if taken := used & set(numbers) or set(numbers[:1]) & set(numbers[1:]):
            raise BadConfig(f"hardware_ports name port {min(taken)} of the instrument twice")
        used |= set(numbers)
        ports[port] = MatrixPort(*numbers)
    unknown = sorted(config.hardware_ports.keys() - {str(port) for port in ports})
    if unknown:
        raise BadConfig(f"hardware_ports name port {unknown[0]!r}, where no fibre ends")
    return ports


def _is_port(number: object) -> bool:
    return isinstance(number, int) and not isinstance(number, bool) and number > 0
