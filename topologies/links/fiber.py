"""A fibre as a Mininet link: topo.addLink(alice, q1, cls=FiberLink, length_km=0.5)."""

from dataclasses import fields, replace
from pathlib import Path

from mininet.link import Intf, Link
from mininet.node import Node, Switch

from topologies.links.keywords import refuse_unknown
from topologies.system.kernel.interfaces import quick, switch_ipv6_off
from topologies.system.machines.laying import lay
from topologies.system.runs import runtime
from wire.parameters.fiber import Fiber, FiberEnd, FiberOptics, optics
from wire.parameters.physics import BadParameter
from wire.registered import NOISE, registered

OPTICS = frozenset(field.name for field in fields(FiberOptics))
# The ports of channel 1 are numbered as Mininet does, those of each further channel so much higher.
PORTS_PER_CHANNEL = 1_000


class Channel(Link):
    """A veth pair for light of one channel."""

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
        """Make the veth pair, and silence IPv6 before an end is up: on a fibre is LLDP alone.

        Its chatter would count as packets of the light's flow entry.
        """
        assert node1 is not None  # Mininet's `fast` links name them
        assert node2 is not None
        lay([(intfname1, addr1, node1), (intfname2, addr2, node2)])
        for node, name in ((node1, intfname1), (node2, intfname2)):
            switch_ipv6_off(node, name)


class FiberLink(Channel):
    """A veth pair whose light is modelled by the dispatcher; of each channel one.

    The bridge gets a real port and Mininet's verbs (net, links, link … down) work on it.
    The host's end is its QNIC and is called <host>-q0, <host>-q1, …
    Optics go by keyword, as the fields of wire.parameters.fiber.FiberOptics; raise BadParameter if
    a value is out of range. A noise model of the user's own is in a file that is relative to where
    the program runs.
    """

    def __init__(self, node1: Node, node2: Node, **params: object) -> None:
        where = f"fibre {node1.name} to {node2.name}"
        optics_given = {name: params.pop(name) for name in OPTICS & params.keys()}
        refuse_unknown(where, params, type(self), Intf, also=sorted(OPTICS))
        described = resolved(optics(where, **optics_given))
        super().__init__(node1, node2, **quick({**params, **_names(node1, node2)}))
        ports = [node.ports[end] for node, end in ((node1, self.intf1), (node2, self.intf2))]
        if described.channels > 1 and max(ports) >= PORTS_PER_CHANNEL:
            raise BadParameter(
                f"{where}: port {max(ports)} of a node cannot have channels; lay fibres that have "
                f"them first, at ports below {PORTS_PER_CHANNEL}"
            )
        fibers, first = runtime.current().fibers, _end(self.intf1)
        fibers.append(Fiber.joining(first, _end(self.intf2), described, 1, _strand(first)))
        self.channels: list[Channel] = []  # beside the first
        for channel in range(2, described.channels + 1):
            near, far = (port + PORTS_PER_CHANNEL * (channel - 1) for port in ports)
            names = {**_names(node1, node2), "port1": near, "port2": far}
            link = Channel(node1, node2, **quick({**params, **names}))
            self.channels.append(link)
            one, other = _end(link.intf1), _end(link.intf2)
            fibers.append(Fiber.joining(one, other, described, channel, _strand(first)))

    def delete(self) -> None:
        for link in self.channels:
            link.delete()
        super().delete()


def channels_of(link: Link) -> list[Channel]:
    """Return the channels of a link beside the first, none of one that is not a fibre."""
    return link.channels if isinstance(link, FiberLink) else []


def _names(*nodes: Node) -> dict[str, str]:
    return {
        f"intfName{number}": f"{node.name}-q{len(qnics(node))}"
        for number, node in enumerate(nodes, 1)
        if not isinstance(node, Switch)
    }


def _strand(end: FiberEnd) -> str:
    return f"{end.node} {end.port}"


def qnics(host: Node) -> list[str]:
    """Return the names of a host's fibre interfaces, in order."""
    prefix = f"{host.name}-q"
    return [name for name in host.intfNames() if name.startswith(prefix)]


def _end(interface: object) -> FiberEnd:
    node = interface.node  # type: ignore[attr-defined]
    port = str(node.ports[interface]) if isinstance(node, Switch) else str(interface)
    return FiberEnd(node.name, port)


def resolved(described: FiberOptics) -> FiberOptics:
    """Return the same with the whole path of the noise model's file, which must be there."""
    return replace(described, noise=python_file("noise", described.noise, NOISE))


def python_file(what: str, reference: str, group: str) -> str:
    """Return "file.py:ClassName" with the whole path of the file, which must be there.

    A name that a package registers in the group, or "", is that.
    """
    if not reference or reference in registered(group):
        return reference
    file, _, name = reference.rpartition(":")
    path = Path(file).resolve()
    if not path.is_file():
        raise BadParameter(f"{what} {reference!r}: there is no file {path}")
    return f"{path}:{name}"
