"""Send a file or standard input through a quantum socket, like netcat.

Prints one line of JSON after every chunk: what the session has used so far.
"""

import argparse
import sys

from hosts.applications.carrying import CHUNK_BYTES
from hosts.applications.service import Part, ask, ended_well
from hosts.middleware.services.superdense.options import DEFAULT_BLOCK_PAIRS
from wire.metadata.vocabulary import FEC_NAMES, Service

OPTIONS = ("handshake", "frame_bytes", "block_pairs", "rate_hz", "fec", "interleave")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m hosts.applications.send", description=__doc__)
    parser.add_argument("--stack", help="socket of this host's stack (QMN_STACK)")
    parser.add_argument("--file", type=argparse.FileType("rb"), default=sys.stdin.buffer)
    parser.add_argument("--handshake", choices=sorted(CHUNK_BYTES), default="framed")
    parser.add_argument("--frame-bytes", type=int, default=256)
    parser.add_argument("--block-pairs", type=int, default=DEFAULT_BLOCK_PAIRS)
    parser.add_argument("--rate-hz", type=int, default=50_000_000)
    parser.add_argument("--fec", choices=FEC_NAMES, default="none", help="error-correction code")
    parser.add_argument("--interleave", action="store_true", help="spread its codewords")
    parser.add_argument("host")
    parser.add_argument("port", type=int)
    arguments = parser.parse_args()
    options = {name: getattr(arguments, name) for name in OPTIONS}
    service = Service.SDC.name.lower()
    part = Part(service, arguments.port, arguments.stack, arguments.host, options, arguments.file)
    return ended_well("send", lambda: ask(part))


if __name__ == "__main__":
    sys.exit(main())
