"""A slow classical channel: packets of quantum metadata really wait for their turn, in the kernel.

            sends                                           copper
    host ---+--> metadata: token bucket, bits a second --+--> s1
            '--> all else, as to the dispatcher ---------'

Rates work where `netem`, with its fixed delays, is missing. The simulation's own messages over the
same copper are not slowed down: it is not what is measured.
"""

import subprocess

from mininet.node import Host

from topologies.system.processes.programs import NetworkError
from topologies.timeouts import COMMAND_TIMEOUT_S
from wire.metadata.header import METADATA_PORT
from wire.parameters.network import MOST_MBPS

# Of one packet: what TCP hands over as one of 64 KiB is cut, and none goes on saved tokens.
BURST_BYTES = 1600
LIMIT_BYTES = 16 << 20  # that may wait
ALL_ELSE, METADATA = "1:1", "1:2"


def slow_metadata(host: Host, rate_mbps: float, time_scale: float) -> None:
    """Let a host send quantum metadata at this rate (Mbit/s of the network), for good; once.

    Raise NetworkError if the kernel cannot do it.
    """
    interface = str(host.defaultIntf())

    def add(what: str, words: str) -> None:
        _run(host, ["tc", what, "add", "dev", interface, *words.split()])

    add("qdisc", "root handle 1: htb default 1")
    for flow in (ALL_ELSE, METADATA):
        rate = f"rate {MOST_MBPS:g}mbit quantum {BURST_BYTES}"
        add("class", f"parent 1: classid {flow} htb {rate}")
    bounds = f"burst {BURST_BYTES} limit {LIMIT_BYTES}"
    bit_per_s = round(rate_mbps * 1e6 / time_scale)
    add("qdisc", f"parent {METADATA} handle 2: tbf rate {bit_per_s}bit {bounds}")
    for end in ("sport", "dport"):
        match = f"match ip protocol 6 0xff match ip {end} {METADATA_PORT} 0xffff"
        add("filter", f"parent 1: protocol ip u32 {match} flowid {METADATA}")


def _run(host: Host, command: list[str]) -> None:
    with host.popen(command) as program:
        try:
            _output, words = program.communicate(timeout=COMMAND_TIMEOUT_S)
        except subprocess.TimeoutExpired as error:
            program.kill()
            raise NetworkError(
                f"{host.name}: {' '.join(command)}: no end in {COMMAND_TIMEOUT_S:g} s"
            ) from error
    if program.returncode:
        raise NetworkError(
            f"{host.name}: {' '.join(command)}: {words.decode().strip()}; a slow classical channel "
            "needs a kernel with sch_htb, sch_tbf and cls_u32: load them, or leave it out"
        )
