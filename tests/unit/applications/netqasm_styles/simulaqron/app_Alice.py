"""Random bits that two have in common, in the manner of SimulaQron's examples: Alice's program.

Connections are opened, flushed and closed by hand, one for each bit; names begin with a capital.
"""

from typing import Any

from netqasm.sdk import EPRSocket
from netqasm.sdk.external import NetQASMConnection, Socket


def generate_bit() -> int:
    """Return an outcome of this half of a new pair."""
    epr_socket = EPRSocket("Bob")
    sim_conn = NetQASMConnection("Alice", epr_sockets=[epr_socket])
    epr = epr_socket.create_keep()[0]
    m = epr.measure()
    sim_conn.flush()
    result = int(m)
    sim_conn.close()
    return result


def main(app_config: Any = None, bits: int = 8) -> list[int] | None:
    """Ask Bob, and make bits."""
    bob = Socket("Alice", "Bob")
    bob.send("generate randomness?")
    if bob.recv() != "yes":
        return None
    return [generate_bit() for _ in range(bits)]
