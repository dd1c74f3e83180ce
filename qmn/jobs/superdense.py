"""The job of sending a message by superdense coding."""

import argparse
import os
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from hosts.applications.carrying import CHUNK_BYTES
from hosts.middleware.services.superdense.coding import CODES
from hosts.middleware.services.superdense.frame_format import FrameFormat
from hosts.middleware.services.superdense.options import SuperdenseOptions
from hosts.middleware.session.options import MAX_BLOCK_PAIRS, MIN_BLOCK_PAIRS
from qmn.jobs import runner
from qmn.jobs.run_context import add_run_options, check_run, guarded
from qmn.jobs.transfer import APPLICATION_PORT
from qmn.network.options import (
    BadInput,
    add_network_options,
    check_network,
    check_range,
    check_two_hosts,
)
from qmn.network.topologies import TOPOLOGIES, quantum_hosts, topology, topology_name
from qmn.results.timeline import MERGE_AT_MOST_BYTES
from topologies.network import Signals, require_root
from wire.metadata import FEC_NAMES, Service

MESSAGE = Path(__file__).with_name("message.txt")
# Bell pairs a second to expect on two cores, for the estimate before the start.
EXPECTED_RATE = {"framed": 2_000_000, "per-pair": 200}
RECORDED_BYTES_PER_PAIR = {"framed": 1.02, "per-pair": 900}
DECODING_RATE = {"reed-solomon": 300_000}  # pairs a second, of codes that take longer than light
CAPTURED_BYTES_PER_PAIR = {"framed": 4.4, "per-pair": 4_900}
# Times that in the timeline of all, where a packet has a longer head.
MERGED = {"framed": 1.02, "per-pair": 1.11}
SIZE_LIMIT = {"framed": 1 << 30, "per-pair": 1 << 16}
TELL_ESTIMATE_ABOVE_S = 10
PACKETISATION = ("frame_bytes", "block_pairs", "rate_hz", "fec", "interleave")
ASKED = ("handshake", *PACKETISATION)  # of the service
PARAMETERS = ("sender", "receiver", *PACKETISATION)  # that the result keeps as such
SERVICE = Service.SDC.name.lower()


def add_parsers(jobs: Any) -> None:
    """Describe the job, which is called as the topology that it runs on."""
    for name, (_topo, what) in TOPOLOGIES.items():
        text = f"superdense coding over {what}"
        job = jobs.add_parser(name, help=text, description=text)
        _add_options(job)
        job.set_defaults(topology=name, call=partial(guarded, run))
        if name == "sdc":
            text = "over a network of your own in place of this one"
            job.add_argument("--topology", type=topology_name, metavar="FILE.py:CLASS", help=text)


def _add_options(parser: argparse.ArgumentParser) -> None:
    add = partial(parser.add_argument)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--message", help="text to send (default: a short text of ours)")
    what.add_argument("--file", type=Path, help="file to send")
    add("--from", dest="sender", default="alice", metavar="HOST", help="sending host (alice)")
    add("--to", dest="receiver", default="bob", metavar="HOST", help="receiving host (bob)")
    add("--handshake", choices=sorted(EXPECTED_RATE), default="framed", help="default: framed")
    add_network_options(parser)
    add("--frame-bytes", type=int, default=256, metavar="N", help="bytes under one check (256)")
    add("--block-pairs", type=int, default=65_536, metavar="N", help="pairs in a block (65536)")
    add("--rate-hz", type=int, default=50_000_000, metavar="HZ", help="of the source (50000000)")
    add("--fec", choices=FEC_NAMES, default="none", help="error-correction code (none)")
    add("--interleave", action="store_true", help="spread the codewords of --fec over a frame")
    add_run_options(parser)


def run(arguments: argparse.Namespace, signals: Signals, console: Console) -> int:
    """Do the whole run and return its exit status."""
    size = check_input(arguments)
    require_root()
    tell_estimate(arguments, size, console)

    def describe(folder: Path) -> runner.Job:
        return job(arguments, message_file(arguments, folder))

    return runner.run(arguments.topology, describe, arguments, signals, console)


def message_file(arguments: argparse.Namespace, folder: Path) -> Path:
    """Return the file to send; a message becomes one in the folder of the run."""
    if arguments.message is None:
        return Path(arguments.file or MESSAGE).resolve()
    file = folder / "message"
    file.write_bytes(arguments.message.encode())
    return file


def job(arguments: argparse.Namespace, file: Path) -> runner.Job:
    """Return the sending of a file."""
    size = file.stat().st_size
    pairs = pairs_of(arguments, size)
    sender, receiver = arguments.sender, arguments.receiver
    asked = {name: getattr(arguments, name) for name in ASKED}
    return runner.Job(
        service=SERVICE,
        options=SuperdenseOptions(receiver, APPLICATION_PORT, **asked),
        opener=sender,
        acceptor=receiver,
        parameters=PARAMETERS,
        said=f"sending {file.name} from {sender} to {receiver} "
        f"by superdense coding ({arguments.handshake})",
        unit="pairs",
        total=pairs,
        done=lambda line: pairs * int(line["delivered_bytes"]) // max(size, 1),
        rate=lambda line: line["bell_pairs"] / max(line["elapsed_s"], 1e-9),
        file=file,
        facts={"handshake": arguments.handshake, "file": str(file)},
    )


def check_input(arguments: argparse.Namespace) -> int:
    """Return the size of the message; raise BadInput before anything is started."""
    hosts = quantum_hosts(topology(arguments)())
    check_two_hosts(arguments.sender, arguments.receiver, hosts)
    size = message_size(arguments)
    limit = SIZE_LIMIT[arguments.handshake]
    if size > limit:
        raise BadInput(
            f"{size:,} bytes: with the handshake {arguments.handshake} at most {limit:,} can be "
            "sent" + ("; use --handshake framed" if arguments.handshake == "per-pair" else "")
        )
    check_network(arguments)
    check_run(arguments)
    check_range(arguments, "frame_bytes", 1, 65_536)
    check_range(arguments, "block_pairs", MIN_BLOCK_PAIRS, MAX_BLOCK_PAIRS)
    check_range(arguments, "rate_hz", 1, 4_000_000_000)
    check_coding(arguments)
    return size


def check_coding(arguments: argparse.Namespace) -> None:
    """Raise BadInput for a code that frames are too long for, or none to interleave."""
    if arguments.interleave and arguments.fec == "none":
        raise BadInput("--interleave spreads the codewords of a code: choose one with --fec")
    pairs = frame_format(arguments).pairs(arguments.frame_bytes)
    if pairs > MAX_BLOCK_PAIRS:
        raise BadInput(
            f"--frame-bytes {arguments.frame_bytes} with --fec {arguments.fec}: a frame needs "
            f"{pairs:,} pairs, at most {MAX_BLOCK_PAIRS:,}; choose fewer bytes"
        )


def frame_format(arguments: argparse.Namespace) -> FrameFormat:
    """Return what frames are made of, if the receiver tells all Bell states apart."""
    return FrameFormat(CODES[FEC_NAMES[arguments.fec]], arguments.interleave)


def pairs_of(arguments: argparse.Namespace, size: int) -> int:
    """Return how many Bell pairs carry a message if none is lost and no frame repeated."""
    used = frame_format(arguments)
    frame_bytes: int = min(arguments.frame_bytes, CHUNK_BYTES[arguments.handshake])
    whole, rest = divmod(size, frame_bytes)
    return whole * used.pairs(frame_bytes) + used.pairs(rest)


def message_size(arguments: argparse.Namespace) -> int:
    """Return how many bytes are to be sent."""
    if arguments.message is not None:
        return len(arguments.message.encode())
    file = arguments.file or MESSAGE
    try:
        if file.exists() and not file.is_file() and not file.is_dir():
            raise BadInput(f"{file} is not a file with an end: save what it gives, and send that")
        with file.open("rb") as opened:
            return os.fstat(opened.fileno()).st_size
    except OSError as error:
        raise BadInput(f"cannot read {file}: {error.strerror}") from error


def tell_estimate(arguments: argparse.Namespace, size: int, console: Console) -> None:
    """Say before the start how long a long message will take."""
    pairs = pairs_of(arguments, size)
    expected = EXPECTED_RATE[arguments.handshake]
    expected = min(expected, DECODING_RATE.get(arguments.fec, expected), arguments.rate_hz)
    seconds = pairs / expected
    if seconds <= TELL_ESTIMATE_ABOVE_S:
        return
    text = f"{size:,} bytes are {pairs:,} Bell pairs: about {seconds / 60:.1f} minutes on two cores"
    if not arguments.no_capture:
        text += f", and {captured_mb(arguments.handshake, pairs):,.0f} MB of captures"
        text += " (--no-capture saves these)"
    if not arguments.no_record:
        recorded = pairs * RECORDED_BYTES_PER_PAIR[arguments.handshake] / 1e6
        text += f", {recorded:,.0f} MB of record (--no-record saves these)"
    console.print(f"{text}; losses take more. Ctrl-C ends it cleanly.")


def captured_mb(handshake: str, pairs: int) -> float:
    """Return what so many pairs leave in captures and, if it is made, in the timeline of all."""
    captured = pairs * CAPTURED_BYTES_PER_PAIR[handshake]
    merged = captured * (1 + MERGED[handshake]) if captured <= MERGE_AT_MOST_BYTES else captured
    return merged / 1e6
