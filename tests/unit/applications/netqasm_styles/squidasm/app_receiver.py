"""Teleportation, then pairs in a loop, in the manner of SquidASM's applications: the receiver."""

from typing import Any

from netqasm.sdk import EPRSocket
from netqasm.sdk.external import NetQASMConnection, Socket, get_qubit_state


def main(app_config: Any = None, pairs: int = 6) -> dict[str, Any]:
    """Correct what is teleported, and return its state; and outcomes along X of pairs."""
    log_config = app_config.log_config
    app_name = app_config.app_name
    epr_socket = EPRSocket("sender")
    classical_socket = Socket(app_name, "sender", log_config=log_config)
    connection = NetQASMConnection(
        app_name=app_name, log_config=log_config, epr_sockets=[epr_socket]
    )
    with connection:
        epr = epr_socket.recv_keep()[0]
        connection.flush()
        m1, m2 = map(int, classical_socket.recv().split(","))
        if m2 == 1:
            epr.X()
        if m1 == 1:
            epr.Z()
        connection.flush()
        state = get_qubit_state(epr)
        epr.free()

        outcomes = connection.new_array(pairs)

        def measure_along_x(_connection: Any, half: Any, pair: Any) -> None:
            half.H()
            half.measure(future=outcomes.get_future_index(pair))

        epr_socket.recv_keep(number=pairs, sequential=True, post_routine=measure_along_x)
    return {"state": state.tolist(), "outcomes": [int(each) for each in outcomes]}
