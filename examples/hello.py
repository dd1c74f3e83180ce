"""A quantum socket: one program for both ends, which knows nothing of qubits.

qmn cli sdc
qmn> bob python examples/hello.py &
qmn> alice python examples/hello.py bob "how are you?"
qmn> bob wait

What bob has heard is shown by his next command: `wait` waits until his program has ended.
"""

import sys

from hosts.quantum_socket import QuantumSocket, QuantumSocketError

PORT = 4000


def listen() -> None:
    """Print what one sender has to say."""
    with QuantumSocket() as listener:  # of the host that this program runs on
        listener.listen(PORT)
        print("listening", flush=True)
        connection, sender = listener.accept()
        with connection:
            while data := connection.recv(4096):
                print(f"{sender}: {data.decode()}", flush=True)


def send(host: str, text: str) -> None:
    """Say it; what arrives is exact, whatever happens to the light."""
    with QuantumSocket() as sending:
        sending.connect((host, PORT), fec="hamming")
        sending.sendall(text.encode())  # returns when the other stack holds every byte
        sending.shutdown()
        print(f"sent, by {sending.statistics['bell_pairs']} Bell pairs")


try:
    send(*sys.argv[1:]) if sys.argv[1:] else listen()
except QuantumSocketError as error:
    sys.exit(f"hello: {error}")
