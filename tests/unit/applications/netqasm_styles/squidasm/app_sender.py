"""Teleportation, then pairs in a loop, in the manner of SquidASM's applications: the sender.

The connection is a context; what is measured goes into arrays of the processing unit, by routines
that it runs for each pair, and into conditions there.
"""

from typing import Any

from netqasm.sdk import EPRSocket, Qubit
from netqasm.sdk.external import NetQASMConnection, Socket
from netqasm.sdk.toolbox import set_qubit_state


def main(app_config: Any = None, phi: float = 0.0, theta: float = 0.0, pairs: int = 6) -> list[int]:
    """Teleport a state; then return outcomes along X of pairs."""
    log_config = app_config.log_config
    app_name = app_config.app_name
    epr_socket = EPRSocket("receiver")
    classical_socket = Socket(app_name, "receiver", log_config=log_config)
    connection = NetQASMConnection(
        app_name=app_name, log_config=log_config, epr_sockets=[epr_socket]
    )
    with connection:
        q = Qubit(connection)
        set_qubit_state(q, phi, theta)
        epr = epr_socket.create_keep()[0]
        q.cnot(epr)
        q.H()
        m1 = q.measure()
        m2 = epr.measure()
        connection.flush()
        classical_socket.send(f"{int(m1)},{int(m2)}")

        outcomes = connection.new_array(pairs)

        def measure_along_x(_connection: Any, half: Any, pair: Any) -> None:
            half.H()
            half.measure(future=outcomes.get_future_index(pair))

        epr_socket.create_keep(number=pairs, sequential=True, post_routine=measure_along_x)
    return [int(each) for each in outcomes]
