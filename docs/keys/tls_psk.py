"""TLS 1.3 by keys of photons: OpenSSL as it is, with an external preshared key (RFC 8446, 4.2.11).

    alice's key manager -- key, its id -> alice -- id --> bob -- id --> his key manager -- key -->

qmn cli sdc --key-pair alice:bob
qmn> bob python docs/keys/tls_psk.py &
qmn> alice python docs/keys/tls_psk.py bob "hello there"

There is no certificate: who lacks the key cannot finish the handshake. Bob sends each line back
from its end. Other users of a host can see the key while openssl runs: it is one of its arguments.
"""

import base64
import json
import os
import socket
import ssl
import subprocess
import sys
import time
from http.client import HTTPSConnection
from uuid import UUID

DOOR, TLS, LONGEST_S = 5003, 5443, 30.0
OK, NO_KEY_YET = 200, 503


def ask(path: str) -> tuple[str, str]:
    """Return id and key (hex) of this host's key manager, by ETSI GS QKD 014."""
    proof = ssl.create_default_context(cafile=os.environ["KME_CA"])
    proof.load_cert_chain(os.environ["SAE_CERT"], os.environ["SAE_KEY"])
    deadline = time.monotonic() + LONGEST_S
    while True:
        manager = HTTPSConnection(os.environ["KME"].removeprefix("https://"), context=proof)
        manager.request("GET", f"/api/v1/keys/{path}")
        answer = manager.getresponse()
        reply = json.load(answer)
        manager.close()
        if answer.status == OK:
            (key,) = reply["keys"]
            return key["key_ID"], base64.b64decode(key["key"]).hex()
        if answer.status != NO_KEY_YET or time.monotonic() > deadline:
            raise ConnectionError(reply["message"])
        time.sleep(0.2)


def openssl(program: str, key_id: str, key: str, *words: str) -> list[str]:
    """Return the command of one end."""
    return ["openssl", program, "-tls1_3", "-brief", "-psk_identity", key_id, "-psk", key, *words]


def serve() -> None:
    """Take the key that a client names, and serve one connection by it."""
    with socket.create_server(("", DOOR)) as listener:
        listener.settimeout(LONGEST_S)
        print("listening", flush=True)
        client, _address = listener.accept()
    with client, client.makefile("rw") as lines:
        named = UUID(lines.readline().strip())
        words = "-nocert", "-accept", str(TLS), "-naccept", "1", "-rev"
        command = openssl("s_server", *ask(f"sae-alice/dec_keys?key_ID={named}"), *words)
        with subprocess.Popen(command):
            print(named, file=lines, flush=True)


def connected(host: str) -> socket.socket:
    """Return a connection to a host, as soon as the server listens there."""
    deadline = time.monotonic() + LONGEST_S
    while True:
        try:
            return socket.create_connection((host, DOOR), LONGEST_S)
        except ConnectionRefusedError:
            if time.monotonic() > deadline:
                raise
        time.sleep(0.1)


def call(host: str, text: str) -> int:
    """Have a new key, name it to the server, and say something by TLS; return openssl's status."""
    key_id, key = ask("sae-bob/enc_keys?size=256")
    with connected(host) as server, server.makefile("rw") as lines:
        print(key_id, file=lines, flush=True)
        if lines.readline().strip() != key_id:
            raise ConnectionError(f"{host} has not taken the key")
    command = openssl("s_client", key_id, key, "-connect", f"{host}:{TLS}", "-ign_eof")
    deadline = time.monotonic() + LONGEST_S
    while True:  # until the server listens
        typed = f"{text}\nCLOSE\n"
        done = subprocess.run(command, input=typed, capture_output=True, text=True, check=False)
        if "Connection refused" not in done.stderr or time.monotonic() > deadline:
            print(done.stdout + done.stderr)
            return done.returncode
        time.sleep(0.1)


if __name__ == "__main__":
    if sys.argv[1:]:
        sys.exit(call(*sys.argv[1:]))
    serve()
