"""A slow classical channel: packets of quantum metadata really wait for their turn, in the kernel.

        sends              HTB                              copper
    host ------> metadata: so many bits a second ---+-----> s1
                 all else, as to the dispatcher: ---'
                 as fast as the machine is

Rates work where `netem`, with its fixed delays, is missing. What the simulation itself says over
the same copper is not slowed down: it is not what is measured.
"""

from mininet.node import Host

from topologies.programs import NetworkError
from wire.metadata import METADATA_PORT

LEAST_MBPS, MOST_MBPS = 0.001, 10_000.0
BURST_BYTES = 1600  # one packet: nothing gets ahead on tokens that it has saved
QUANTUM_BYTES = 1514
ALL_ELSE, METADATA = "1:1", "1:2"


def slow_metadata(host: Host, rate_mbps: float) -> None:
    """Let a host send quantum metadata at this rate (Mbit/s) from now on.

    Raise NetworkError if the kernel cannot do it.
    """
    interface = str(host.defaultIntf())
    # A packet of 64 KiB would be counted when it has gone, and go at once.
    _run(host, ["ethtool", "-K", interface, "tso", "off", "gso", "off"])
    words = ["tc", "qdisc", "replace", "dev", interface, "root", "handle", "1:"]
    _run(host, [*words, "htb", "default", "1"])
    for flow, rate in ((ALL_ELSE, MOST_MBPS), (METADATA, rate_mbps)):
        words = ["tc", "class", "replace", "dev", interface, "parent", "1:", "classid", flow]
        words += ["htb", "rate", f"{round(rate * 1e6)}bit", "quantum", str(QUANTUM_BYTES)]
        if flow == METADATA:
            words += ["burst", str(BURST_BYTES), "cburst", str(BURST_BYTES)]
        _run(host, words)
    for end in ("sport", "dport"):
        words = ["tc", "filter", "add", "dev", interface, "parent", "1:", "protocol", "ip", "u32"]
        words += ["match", "ip", "protocol", "6", "0xff"]
        words += ["match", "ip", end, str(METADATA_PORT), "0xffff", "flowid", METADATA]
        _run(host, words)


def _run(host: Host, command: list[str]) -> None:
    _output, told, status = host.pexec(command)
    if status:
        raise NetworkError(
            f"{host.name}: {' '.join(command[:3])} failed ({told.strip()}): the kernel must have "
            "sch_htb and cls_u32 for a slow classical channel; see `qmn doctor`"
        )
