"""A quantum socket: one program for both ends, which knows nothing of qubits.

qmn cli sdc
qmn> bob python examples/hello.py &
qmn> alice python examples/hello.py bob "how are you?"
qmn> bob wait

alice's program waits until bob's listens. His next command shows the message: `wait`
waits until his program has ended.
"""

import sys
import time

from hosts.quantum_socket import QuantumSocket, QuantumSocketError
from wire.metadata.vocabulary import Reason

PORT = 4000
WAIT_S = 20.0  # of either program for the other


def listen() -> None:
    """Print what one sender has to say."""
    with QuantumSocket() as listener:  # of the host that this program runs on
        listener.listen(PORT)
        listener.settimeout(WAIT_S)
        print("listening", flush=True)
        connection, sender = listener.accept()
        with connection:
            while data := connection.recv(4096):
                print(f"{sender}: {data.decode()}", flush=True)


def connected(host: str) -> QuantumSocket:
    """Return a connection to a host, as soon as a program listens there."""
    deadline = time.monotonic() + WAIT_S
    while True:
        sending = QuantumSocket()
        try:
            sending.connect((host, PORT), fec="hamming")
            return sending
        except QuantumSocketError as error:
            sending.close()
            if error.reason != Reason.NO_LISTENER or time.monotonic() > deadline:
                raise
        time.sleep(0.1)


def send(host: str, text: str) -> None:
    """Say it; what arrives is exact, whatever happens to the light."""
    with connected(host) as sending:
        sending.sendall(text.encode())  # returns when the other stack holds every byte
        sending.shutdown()
        print(f"sent, by {sending.statistics['bell_pairs']} Bell pairs")


try:
    send(*sys.argv[1:]) if sys.argv[1:] else listen()
except (QuantumSocketError, TimeoutError) as error:
    sys.exit(f"hello: {error}")
