"""Download a file by HTTP at a steady rate of the network, and say how far it is.

Prints a line of JSON twice a second, and one with the SHA-256 at the end. A server that is silent
for a long while is waited for: what carries its packets may be closed.
"""

import argparse
import json
import sys
import time
from hashlib import sha256
from http.client import HTTPException
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

from applications.timeouts import DOWNLOAD_TELL_S, DOWNLOAD_TIMEOUT_S
from programs.faults import report_fault
from wire.network_time import NetworkTime

CHUNKS_PER_S = 20


def say(event: str, **fields: object) -> None:
    print(json.dumps({"event": event, "at": time.time(), **fields}), flush=True)


def download(url: str, output: Path, bytes_per_s: float, clock: NetworkTime) -> None:
    """Write what comes to a file."""
    digest, received, chunk = sha256(), 0, max(1, int(bytes_per_s / CHUNKS_PER_S))
    reported = time.monotonic()
    with (
        urlopen(url, timeout=clock.wall_s(DOWNLOAD_TIMEOUT_S)) as response,  # noqa: S310
        output.open("wb") as file,
    ):
        whole = int(response.headers["Content-Length"])
        while data := response.read(chunk):
            begun = time.monotonic()
            file.write(data)
            digest.update(data)
            received += len(data)
            if begun - reported >= DOWNLOAD_TELL_S:
                reported = begun
                say("received", bytes=received)
            time.sleep(clock.wall_s(len(data) / bytes_per_s))
    if received != whole:
        raise HTTPException(f"{received} bytes arrived of {whole}")
    say("downloaded", bytes=received, sha256=digest.hexdigest())


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m applications.vpn.download", description=__doc__
    )
    parser.add_argument("--bytes-per-s", type=float, required=True)
    parser.add_argument("--time-scale", type=float, default=1.0)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("url", help="http://...")
    arguments = parser.parse_args()
    if not arguments.url.startswith("http://"):
        parser.error(f"{arguments.url}: HTTP only")
    try:
        clock = NetworkTime(arguments.time_scale)
        download(arguments.url, arguments.output, arguments.bytes_per_s, clock)
    except (OSError, URLError, HTTPException) as error:
        return report_fault(f"download: {error}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
