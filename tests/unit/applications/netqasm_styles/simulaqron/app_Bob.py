"""Random bits that two have in common, in the manner of SimulaQron's examples: Bob's program."""

from typing import Any

from netqasm.sdk import EPRSocket
from netqasm.sdk.external import NetQASMConnection, Socket


def generate_bit() -> int:
    """Return an outcome of this half of a new pair."""
    epr_socket = EPRSocket("Alice")
    sim_conn = NetQASMConnection("Bob", epr_sockets=[epr_socket])
    epr = epr_socket.recv_keep()[0]
    m = epr.measure()
    sim_conn.flush()
    result = int(m)
    sim_conn.close()
    return result


def main(app_config: Any = None, bits: int = 8) -> list[int] | None:
    """Agree, and make bits."""
    alice = Socket("Bob", "Alice")
    if alice.recv() != "generate randomness?":
        return None
    alice.send("yes")
    return [generate_bit() for _ in range(bits)]
