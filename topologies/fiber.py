"""A fibre as a Mininet link: topo.addLink(alice, q1, cls=FiberLink, length_km=0.5)."""

from mininet.link import Link
from mininet.node import Node, Switch

from topologies import runtime
from wire.config import Fiber, FiberEnd

RANGES = {
    "length_km": (0.0, 2_000.0),
    "loss_db_per_km": (0.0, 1_000.0),
    "depolarizing": (0.0, 1.0),
}


class FiberLink(Link):
    """A veth pair whose light is modelled by the dispatcher.

    The bridge gets a real port and Mininet's verbs (net, links, link … down) work on it.
    The host's end is its QNIC and is called <host>-q0, <host>-q1, …
    """

    def __init__(
        self,
        node1: Node,
        node2: Node,
        length_km: float = 0.01,
        loss_db_per_km: float = 0.0,
        depolarizing: float = 0.0,
        **params: object,
    ) -> None:
        _check("length_km", length_km)
        _check("loss_db_per_km", loss_db_per_km)
        _check("depolarizing", depolarizing)
        network = runtime.current()
        for key, node in (("intfName1", node1), ("intfName2", node2)):
            if not isinstance(node, Switch):
                params[key] = qnic_name(node)
        super().__init__(node1, node2, **params)
        for end in (self.intf1, self.intf2):
            _silence(end)
        ends = (_end(self.intf1), _end(self.intf2))
        network.fibers.append(Fiber(*ends, length_km, loss_db_per_km, depolarizing))

    @classmethod
    def makeIntfPair(  # noqa: N802 (Mininet's name)
        cls,
        intfname1: str,
        intfname2: str,
        addr1: str | None = None,
        addr2: str | None = None,
        node1: Node | None = None,
        node2: Node | None = None,
        deleteIntfs: bool = True,  # noqa: N803
    ) -> None:
        """Make the veth pair, and silence IPv6 before an end is up: on a fibre is LLDP alone."""
        super().makeIntfPair(intfname1, intfname2, addr1, addr2, node1, node2, deleteIntfs)
        for node, name in ((node1, intfname1), (node2, intfname2)):
            assert node is not None  # Mininet's `fast` links name them
            node.cmd(f"sysctl -qw net.ipv6.conf.{name}.disable_ipv6=1")


def qnic_name(host: Node) -> str:
    """Return the name of a host's next fibre interface."""
    return f"{host.name}-q{len(qnics(host))}"


def qnics(host: Node) -> list[str]:
    """Return the names of a host's fibre interfaces, in order."""
    prefix = f"{host.name}-q"
    return [name for name in host.intfNames() if name.startswith(prefix)]


def _end(interface: object) -> FiberEnd:
    node = interface.node  # type: ignore[attr-defined]
    port = str(node.ports[interface]) if isinstance(node, Switch) else str(interface)
    return FiberEnd(node.name, port)


def _silence(interface: object) -> None:
    """Switch IPv6 off, whose chatter would count as packets of the light's flow entry."""
    node = interface.node  # type: ignore[attr-defined]
    node.cmd(f"sysctl -qw net.ipv6.conf.{interface}.disable_ipv6=1")


def _check(name: str, value: float) -> None:
    least, most = RANGES[name]
    if not least <= value <= most:
        raise ValueError(f"{name}={value} of a fibre: choose {least:g} to {most:g}")
