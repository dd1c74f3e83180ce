"""A service: entangled pairs, measured at both ends, are coins that two hosts throw alike.

qmn cli sdc --device charlie.source.fidelity=0.95
qmn> bob python examples/coins.py &
qmn> alice python examples/coins.py bob
"""

import sys
from collections.abc import Sequence

from hosts.service_socket import QuantumSocketError, ServiceSocket

PORT, COINS = 9, 32


def shown(outcomes: Sequence[int | None]) -> str:
    """Return heads and tails; a coin whose photon no detector has seen is a dot."""
    return "".join("." if outcome is None else "HT"[outcome] for outcome in outcomes)


def ask(host: str) -> None:
    """Have pairs put into the memories of both hosts, and measure our halves."""
    with ServiceSocket() as asking:
        for result in asking.request("distribute", (host, PORT), count=COINS):
            print(f"{result['pairs']} pairs")
        print(shown(asking.ask(measure=list(range(COINS)), basis="Z")["outcomes"]))
        asking.shutdown()


def listen() -> None:
    """Measure the other halves, whenever they have come."""
    with ServiceSocket() as listener:
        listener.listen(PORT, "distribute")
        print("listening", flush=True)
        connection, _peer = listener.accept()
        with connection:
            list(connection.results())  # until all have come
            outcomes = connection.ask(measure=list(range(COINS)), basis="Z")["outcomes"]
            print(shown(outcomes), flush=True)
            list(connection.results())  # until the one that asked ends the session


try:
    ask(*sys.argv[1:]) if sys.argv[1:] else listen()
except QuantumSocketError as error:
    sys.exit(f"coins: {error}")
