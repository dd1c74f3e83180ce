"""Mininet's `iperf` for the iperf of today.

Mininet 2.3 waits for ever for a second report of the server, which iperf 2.1 does not make, and
ends every iperf on the machine by name.
"""

import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

from mininet.log import output
from mininet.net import Mininet
from mininet.node import Node

from topologies.system.processes.programs import NetworkError
from topologies.timeouts import IPERF_TIMEOUT_S, POLL_S


class IperfMininet(Mininet):
    """Mininet whose `iperf` ends."""

    def iperf(  # its parameters are Mininet's
        self,
        hosts: Sequence[Node] | None = None,
        l4Type: str = "TCP",  # noqa: N803
        udpBw: str = "10M",  # noqa: N803
        fmt: str | None = None,
        seconds: float = 5,
        port: int = 5001,
    ) -> list[str]:
        """Print and return the rates that server and client saw, behind that asked for with UDP.

        Raise NetworkError if iperf does not listen, or does not end.
        """
        client, server = hosts or (self.hosts[0], self.hosts[-1])
        output(f"*** Iperf: testing {l4Type} bandwidth between {client} and {server}\n")
        kind = ["-u"] if l4Type == "UDP" else []
        common = ["iperf", "-p", str(port), *kind, *(["-f", fmt] if fmt else [])]
        rate = ["-b", udpBw] if kind else []
        sending = [*common, "-c", server.IP(), "-t", str(seconds), *rate]
        with _running(server, [*common, "-s", "-P", "1"]) as receiver:
            try:
                _wait_until_listening(receiver, server, "udp" if kind else "tcp", port)
                with _running(client, sending) as sender:
                    try:
                        sent, _ = sender.communicate(timeout=seconds + IPERF_TIMEOUT_S)
                    finally:
                        sender.kill()
                received, _ = receiver.communicate(timeout=IPERF_TIMEOUT_S)
            except subprocess.TimeoutExpired as error:
                raise NetworkError(f"iperf from {client} to {server} did not end") from error
            finally:
                receiver.kill()
        rates = [self._parseIperf(text) for text in (received, sent)]
        result = [udpBw, *rates] if kind else rates
        output(f"*** Results: {result}\n")
        return result


def _running(node: Node, command: list[str]) -> "subprocess.Popen[str]":
    process: subprocess.Popen[str] = node.popen(
        command, text=True, stdin=subprocess.DEVNULL, stderr=subprocess.STDOUT
    )
    return process


def _wait_until_listening(
    receiver: "subprocess.Popen[str]", node: Node, protocol: str, port: int
) -> None:
    """Wait until somebody listens at a port of a node; raise NetworkError if nobody does."""
    deadline = time.monotonic() + IPERF_TIMEOUT_S
    while f":{port:04X} " not in Path(f"/proc/{node.pid}/net/{protocol}").read_text():
        if receiver.poll() is not None or time.monotonic() > deadline:
            raise NetworkError(f"iperf does not listen at {protocol} port {port} of {node}")
        time.sleep(POLL_S)
