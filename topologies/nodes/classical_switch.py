"""A switch of copper."""

import re
import shlex
from collections.abc import Mapping, Sequence

from mininet.link import Intf
from mininet.node import Controller, OVSSwitch

from topologies.links.keywords import refuse_unknown
from topologies.nodes.copper import connect_copper
from topologies.nodes.node import QuantumNode
from topologies.nodes.reached import as_reached
from topologies.system.open_vswitch import openvswitch
from topologies.system.runs import runtime
from topologies.timeouts import BUSY_MS, PROBE_MS, RECONNECT_MS, STEPPED_PROBE_MS

PATIENCE = 8  # times the way to the controller
# Packets a second for the controller, some four of them for a session: more wait, in a queue for
# each port, and these are served in turn, so that a host that floods fills its own (Open vSwitch's
# pinsched). Where others want processors, too, the controller takes not many more.
SHARES = {"controller_rate_limit": 2000, "controller_burst_limit": 1000}


class ClassicalSwitch(QuantumNode, OVSSwitch):
    """An Open vSwitch bridge that speaks OpenFlow 1.4 and forwards only by its flow entries.

    Its datapath ID is the first number in its name, as in Mininet, unless `dpid` is given.
    """

    first_dpid = 0  # of the one with number 0 in its name

    def __init__(self, name: str, **params: object) -> None:
        refuse_unknown(name, params, type(self))
        self.network = runtime.current()
        settings = {
            "datapath": openvswitch.datapath(),
            "protocols": "OpenFlow14",
            "failMode": "secure",
            "reconnectms": RECONNECT_MS,
        }
        super().__init__(name, **{**params, **settings})
        self.stands = False
        self.network.bridges[name] = self

    @classmethod
    def dpid_of(cls, name: str) -> str:
        """Return the datapath ID that a name stands for, in hexadecimal; "" without a number."""
        number = re.search(r"\d+", name)
        return f"{cls.first_dpid + int(number[0]):x}" if number else ""

    def defaultDpid(self, dpid: str | None = None) -> str:  # noqa: N802 (Mininet's name)
        digits: str = super().defaultDpid(dpid or self.dpid_of(self.name))
        return digits

    @classmethod
    def isOldOVS(cls) -> bool:  # noqa: N802 (Mininet's name)
        """Say that Open vSwitch is of this century, without asking it."""
        return False

    @classmethod
    def batchShutdown(  # noqa: N802 (Mininet's name)
        cls, switches: Sequence["ClassicalSwitch"], run: object = None
    ) -> Sequence["ClassicalSwitch"]:
        """Delete bridges together, by a command that ends also where Open vSwitch has ended."""
        del run
        for switch in switches:
            switch.hang_up()
        try:
            openvswitch.delete(*(switch.name for switch in switches))
        finally:
            for switch in switches:
                switch.terminate()
        return switches

    @classmethod
    def batchStartup(  # noqa: N802 (Mininet's name)
        cls, switches: Sequence["ClassicalSwitch"], run: object = None
    ) -> Sequence["ClassicalSwitch"]:
        """Have all of them started already, where Mininet would run what they have put off."""
        del run
        return switches

    def start(self, controllers: list[Controller]) -> None:
        """Start the bridge; whichever the controller is, copper has its length by then.

        It looks for our own controller on the management network.
        """
        connect_copper(self.network)
        self.lay()
        reached = [as_reached(controller, self.name) for controller in controllers]
        self._obey(
            {
                f"{each.protocol}:{each.IP()}:{each.port}": self._patience(each.name) | SHARES
                for each in reached
            }
        )

    def lay(self) -> None:
        """Make the bridge with its ports, which nobody programs yet."""
        if self.stands:
            return
        ports = [port for port in self.intfList() if self.ports[port] and not port.IP()]
        columns = {str(port): self._columns(port) for port in ports}
        options = shlex.split(self.bridgeOpts())
        openvswitch.change(*bridge_words(self.name, options, columns))
        for port in self.intfList():
            self.TCReapply(port)  # Open vSwitch has overwritten it
        self.stands = True

    def _columns(self, port: Intf) -> list[str]:
        """Return what Mininet sets of a port's interface, after `-- set Interface NAME`."""
        return shlex.split(self.intfOpts(port))[4:]

    def _obey(self, targets: Mapping[str, Mapping[str, int]]) -> None:
        words: list[str] = []
        for number, (target, settings) in enumerate(targets.items()):
            words += ["--", f"--id=@{self.name}c{number}", "create", "Controller"]
            words += [f'target="{target}"', *(f"{key}={value}" for key, value in settings.items())]
        rows = ",".join(f"@{self.name}c{number}" for number in range(len(targets)))
        openvswitch.change(*words, "--", "set", "bridge", self.name, f"controller=[{rows}]")
        self._uuids: list[str] = []  # in which Mininet keeps the rows of before

    def _patience(self, controller: str) -> dict[str, int]:
        """Let Open vSwitch wait as long for a controller as the way there takes.

        And, for its answer, as long as one needs that takes in a large network at its start; where
        time is stepped, no program is late.
        """
        way_s = self.network.copper.get(frozenset((controller, self.name)), 0.0)
        wait_ms = round(1e3 * PATIENCE * self.network.time.wall_s(way_s))
        settings = {"max_backoff": max(wait_ms, RECONNECT_MS)}  # Open vSwitch's own is 8 s
        busy_ms = BUSY_MS * len(self.network.addresses)
        if self.network.stepped:
            busy_ms = STEPPED_PROBE_MS
        if wait_ms >= RECONNECT_MS or busy_ms > PROBE_MS:
            settings["inactivity_probe"] = max(wait_ms, busy_ms)
        return settings

    def stop(self, deleteIntfs: bool = True) -> None:  # noqa: N803 (Mininet's name)
        """Take the bridge away, as `switch s1 stop` does; `start` brings it back.

        Mininet would end the node's shell, too, and could not start it again.
        """
        openvswitch.delete(self.name)
        self.stands = False
        if deleteIntfs:
            self.deleteIntfs()

    def dpctl(self, *arguments: str) -> str:
        command, *rest = arguments
        return self.cmd("ovs-ofctl -O OpenFlow14", command, self, *rest)

    def vsctl(self, *arguments: str, **_options: object) -> str:
        """Run ovs-vsctl; unlike Mininet's own, say so if it fails."""
        return openvswitch.change(*shlex.split(" ".join(map(str, arguments))))


def bridge_words(
    name: str, options: Sequence[str], interfaces: Mapping[str, Sequence[str]]
) -> list[str]:
    """Return the words for a bridge, in place of an existing one of that name.

    Options are columns, as "fail_mode=secure"; interfaces are the columns of each, by its name.

    `add-port` and `set Interface NAME` look a name up among all ports, also those of the same
    transaction, and `add-br` has all of them read again: time with the square of the ports. Rows
    that `create` makes, and that name each other, take none of that.
    """
    steps = ["--if-exists", "del-br", name]
    ports = []
    for number, (each, columns) in enumerate({name: ["type=internal"], **interfaces}.items()):
        interface, port = f"@{name}i{number}", f"@{name}p{number}"
        steps += ["--", f"--id={interface}", "create", "Interface", _named(each), *columns]
        steps += ["--", f"--id={port}", "create", "Port", _named(each), f"interfaces={interface}"]
        ports.append(port)
    bridge = f"@{name}b"
    steps += ["--", f"--id={bridge}", "create", "Bridge", _named(name)]
    steps += [f"ports=[{','.join(ports)}]", *options]
    return [*steps, "--", "add", "Open_vSwitch", ".", "bridges", bridge]


def _named(name: str) -> str:
    return f'name="{name}"'
