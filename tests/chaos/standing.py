"""Strikes at one network that stands: each is mended, and what comes after it is to work again.

A run ends by most strikes; here are those that a network has to outlive: its controller and the
agents of its switches killed and started again, any program or daemon stopped for a while, fibres
and copper cut for a while, an application gone in mid-transfer. A strike meets a transfer of random
bytes. It arrives as it was sent, or both ends hear why not; and another one right after it arrives.
"""

import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

import machine

from hosts.quantum_socket import QuantumSocket, QuantumSocketError
from qmn.scripting import QuantumNetwork, start
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.programs import Program, python
from wire.controller_lines import read_record

TRANSFER_BYTES = 1 << 18
AFTER = b"what comes after a strike"
STOPPED_S = (0.05, 0.5)
CUT_S = (0.02, 0.3)
# Until the network works again, where a process has a processor of its own. A session whose end
# comes between two controllers, and whose hosts do not answer the second, keeps its fibres until it
# has been silent for half a minute, twice.
HEAL_S = 90.0
LOOK_S = 0.02
PORTS = range(100, 30_000)

Strike = Callable[["Standing", Random], str]


@dataclass
class Struck:
    """The result of one strike."""

    number: int
    what: str
    text: str = ""  # by the transfer that it met, if that failed
    faults: list[str] = field(default_factory=list)
    healed_after_s: float = 0.0
    is_strike: bool = True  # or what is left when the network is gone


class Transfer:
    """Bytes on their way from alice to bob."""

    def __init__(self, network: QuantumNetwork, port: int, data: bytes) -> None:
        self.data, self.received, self.text = data, bytearray(), ""
        self._sender = QuantumSocket(network.runtime.socket("alice"))
        self._listener = QuantumSocket(network.runtime.socket("bob"))
        self._port = port
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self._thread.start()

    def _carry(self) -> None:
        with self._listener, self._sender:
            try:
                self._listener.listen(self._port)
                self._sender.connect(("bob", self._port))
                receiver, _peer = self._listener.accept()
                with receiver:
                    sending = threading.Thread(target=self._send, daemon=True)
                    sending.start()
                    while len(self.received) < len(self.data):
                        if not (part := receiver.recv(1 << 16)):
                            break
                        self.received += part
                    sending.join()
            except (QuantumSocketError, OSError) as error:
                self.text = self.text or str(error)

    def _send(self) -> None:
        try:
            self._sender.sendall(self.data)
        except (QuantumSocketError, OSError) as error:
            self.text = self.text or str(error)

    def give_up(self) -> None:
        """Leave, as an application that ends."""
        self._sender.close()

    def finish(self, timeout_s: float) -> bool:
        """Wait for its end; return whether it came."""
        had_s = 0.0
        while self._thread.is_alive() and had_s < timeout_s:
            began = time.monotonic()
            self._thread.join(LOOK_S)
            had_s += (time.monotonic() - began) / machine.slowness()
        return not self._thread.is_alive()

    def faults(self) -> list[str]:
        """Return what is wrong with what has arrived."""
        got = bytes(self.received)
        if not self.data.startswith(got):
            return ["received bytes that nobody sent"]
        if len(got) < len(self.data) and not self.text:
            return ["less arrived than was sent, and nobody heard why"]
        return []


class Standing:
    """The network, and what can be struck of it."""

    def __init__(self, network: QuantumNetwork) -> None:
        self.network = network
        self.transfer: Transfer | None = None
        self._ports = iter(PORTS)

    def begin(self, data: bytes) -> Transfer:
        """Send bytes from alice to bob."""
        self.transfer = Transfer(self.network, next(self._ports), data)
        return self.transfer

    def heard(self, event: str) -> int:
        """Return how many facts of a kind the controller has recorded."""
        record = read_record(self.network.runtime.logs)
        return sum(fact["event"] == event for fact in record)

    def restart(self, program: Program, module: str, *words: str, pid: int | None = None) -> None:
        """Kill a program, and start another like it."""
        before, folder = self.heard("switch"), self.network.runtime.folder
        name = program.name
        program.kill()
        config = folder / f"{name}.json"
        command = [python(), "-m", module, "--config", str(config), *words]
        program.start(command, pid, forks=self.network.runtime.forks())
        wanted = 1 if name.endswith("-agent") else len(self.network.net.switches)
        deadline = time.monotonic() + HEAL_S * machine.slowness()
        while self.heard("switch") < before + wanted and time.monotonic() < deadline:
            time.sleep(LOOK_S)


def controller_killed(standing: Standing, _random: Random) -> str:
    """Kill c0; another takes over its sessions."""
    (c0,) = standing.network.net.controllers
    framework = standing.network.runtime.settings.controller
    standing.restart(c0.program, "controller_apps", "--framework", framework, pid=c0.pid)
    return "SIGKILL to c0"


def agent_killed(standing: Standing, random: Random) -> str:
    """Kill the agent of a switch; its bridge keeps the light paths."""
    name = random.choice(sorted(standing.network.runtime.switches))
    standing.restart(standing.network.net.get(name).program, "qswitch_agent")
    return f"SIGKILL to {name}-agent"


def stopped(standing: Standing, random: Random) -> str:
    """Stop a program of the network, or a daemon of Open vSwitch, and let it go on."""
    programs = *standing.network.runtime.programs, *openvswitch.programs()
    targets = sorted((each.name, each.pid) for each in programs if each.running)
    name, pid = random.choice(targets)
    os.kill(pid, signal.SIGSTOP)
    time.sleep(random.uniform(*STOPPED_S))
    os.kill(pid, signal.SIGCONT)
    return f"SIGSTOP to {name}"


def fiber_cut(standing: Standing, random: Random) -> str:
    """Cut a fibre at a quantum switch, and mend it."""
    names = sorted(path.name for path in Path("/sys/class/net").iterdir())
    optical = tuple(f"{name}-eth" for name in standing.network.runtime.switches)
    return _down(random.choice([name for name in names if name.startswith(optical)]), random)


def copper_cut(_standing: Standing, random: Random) -> str:
    """Cut the copper of a host at its switch, and mend it."""
    names = sorted(path.name for path in Path("/sys/class/net").iterdir())
    return _down(random.choice([name for name in names if name.startswith("s1-eth")]), random)


def _down(name: str, random: Random) -> str:
    machine.run("ip", "link", "set", name, "down")
    time.sleep(random.uniform(*CUT_S))
    machine.run("ip", "link", "set", name, "up")
    return f"down, up of {name}"


def application_gone(standing: Standing, _random: Random) -> str:
    """Let the application that sends leave in mid-transfer."""
    assert standing.transfer is not None
    standing.transfer.give_up()
    return "alice's application leaves"


STRIKES: tuple[tuple[int, Strike], ...] = (
    (5, stopped),
    (5, fiber_cut),
    (4, copper_cut),
    (4, application_gone),
    (2, agent_killed),
    (1, controller_killed),
)


def strikes(count: int, seed: int, first: int, deadline: float) -> Iterator[Struck]:
    """Make a number of strikes at one network, until a deadline; yield the result of each.

    The last result has no strike: what is left when the network is gone.
    """
    before = machine.things()
    with tempfile.TemporaryDirectory(prefix="chaos") as folder:
        # Cut copper loses what TCP repeats by the wall.
        with start("ring", Path(folder) / "run", switches=3, time="paced") as network:
            standing = Standing(network)
            number = first
            while number < first + count and time.monotonic() < deadline:
                yield one(standing, number, Random(f"{seed}/{number}"))
                number += 1
            network.check()
        yield Struck(number, "the end", faults=machine.left(before), is_strike=False)


def one(standing: Standing, number: int, random: Random) -> Struck:
    """Make one strike at a transfer, and see that the next transfer arrives."""
    data = random.randbytes(random.randrange(1, TRANSFER_BYTES))
    moment_s = random.uniform(0.0, 0.2)
    ((_weight, strike),) = random.choices(STRIKES, [weight for weight, _ in STRIKES])
    met = standing.begin(data)
    time.sleep(moment_s)
    made = Struck(number, strike(standing, random))
    struck = time.monotonic()
    if not met.finish(HEAL_S):
        made.faults.append(f"the transfer hangs; {len(met.received)} of {len(data)} bytes arrived")
        return made
    made.text, made.faults = met.text, met.faults()
    after = standing.begin(AFTER)
    while after.finish(HEAL_S) and after.text and time.monotonic() < struck + HEAL_S:
        after = standing.begin(AFTER)  # a port may not be up again yet
    made.healed_after_s = round(time.monotonic() - struck, 2)
    if after.text or bytes(after.received) != AFTER:
        made.faults.append(f"nothing arrives any more: {after.text or 'it hangs'}")
    return made


def describe(made: Struck) -> str:
    """Return one strike in one line."""
    text = f"; {made.text[:100]}" if made.text else ""
    wrong = "".join(f"; WRONG: {fault}" for fault in made.faults)
    return f"{made.number:4} {made.what:28} whole after {made.healed_after_s:5.2f} s{text}{wrong}"
