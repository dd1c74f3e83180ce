"""The job of sending a message by superdense coding."""

import os
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from hosts.applications.carrying import CHUNK_BYTES
from hosts.middleware.services.superdense.coding import CODES
from hosts.middleware.services.superdense.frame_format import FrameFormat
from hosts.middleware.services.superdense.options import SuperdenseOptions
from hosts.middleware.session.options import MAX_BLOCK_PAIRS
from qmn.jobs import runner
from qmn.jobs.run_context import RunContext
from qmn.network.checks import FROM_TO, check_network, check_two_hosts
from qmn.network.custom_topology import short_name
from qmn.network.description import NetworkDescription, describe_network
from qmn.network.felt_settings import Felt, checked_settings, felt_by
from qmn.network.light_checks import check_light
from qmn.options import BadInput, check_ranges
from qmn.requests.superdense import SERVICE, SuperdenseRequest
from qmn.results.run_folder import begin_folder
from qmn.results.timeline import MERGE_AT_MOST_BYTES, WHOLE_AT_MOST_BYTES
from topologies.networks.captures import MAX_PACKET_BYTES
from topologies.networks.network import Signals
from topologies.networks.requirements import require_free
from wire.metadata.vocabulary import FEC_NAMES
from wire.results.figures import Figures, SentFigures

MESSAGE = Path(__file__).with_name("message.txt")
# Bell pairs a second to expect on two cores, for the estimate before the start.
EXPECTED_RATE = {"framed": 2_000_000, "per-pair": 200, "sequential": 50}
RECORDED_BYTES_PER_PAIR = {"framed": 0.27, "per-pair": 900, "sequential": 900}
DECODING_RATE = {"reed-solomon": 300_000}  # pairs a second, of codes that take longer than light
CAPTURED_BYTES_PER_PAIR = {"framed": 1.18, "per-pair": 4_900, "sequential": 4_900}
# Times that in the timeline of all, where a packet has a longer head; and of heads alone.
MERGED = {"framed": 1.02, "per-pair": 1.11, "sequential": 1.11}
MERGED_HEADS = {"framed": 0.17, "per-pair": 0.9, "sequential": 0.9}
SIZE_LIMIT = {"framed": 1 << 30, "per-pair": 1 << 16, "sequential": 1 << 16}
TELL_ESTIMATE_ABOVE_S = 10


def run(request: SuperdenseRequest, signals: Signals, console: Console) -> int:
    return 0 if runner.run(*begun(request, signals, console)).delivered else 1


def begun(
    request: SuperdenseRequest, signals: Signals, console: Console
) -> tuple[runner.Job, RunContext]:
    request, network = checked(request)
    require_free(network.topo)
    tell_estimate(request, message_size(request), console)
    folder = begin_folder(request.run.runs, short_name(request.network.topology))
    context = RunContext(network, request.run, folder, signals, console)
    return job(request, message_file(request, folder)), context


def checked(request: SuperdenseRequest) -> tuple[SuperdenseRequest, NetworkDescription]:
    """Return the request with what follows from it, and its network.

    Raise BadInput or BadTopology before anything is started.
    """
    request, network, felt = fitted(request, describe_network(request.network))
    return request, checked_settings(SERVICE, felt, network)


def fitted(
    request: SuperdenseRequest, network: NetworkDescription
) -> tuple[SuperdenseRequest, NetworkDescription, Felt]:
    """Return the request as a network has it, the network, and what of its settings it can feel.

    Raise BadInput for what cannot be done there.
    """
    options = replace(request.options, host=network.node(request.receiver))
    request = replace(request, sender=network.node(request.sender), options=options)
    check_input(request, network.hosts, network.dark_hosts)
    network = network.paced_for(*request.run.against_steps)
    ends = request.sender, request.receiver
    check_light(SERVICE, ends, network.parts)
    return request, network, felt_by(SERVICE, ends, network.parts)


def message_file(request: SuperdenseRequest, folder: Path) -> Path:
    """Return the file to send; a message becomes one in the folder of the run."""
    if request.message is None:
        return Path(request.file or MESSAGE).resolve()
    file = folder / "message"
    file.write_bytes(request.message.encode())
    return file


def job(request: SuperdenseRequest, file: Path) -> runner.Job:
    size = file.stat().st_size
    options, pairs = request.options, pairs_of(request.options, size)
    return runner.Job(
        service=SERVICE,
        options=options,
        opener=request.sender,
        acceptor=request.receiver,
        request=request,
        announcement=f"sending {file.name} from {request.sender} to {request.receiver} "
        f"by superdense coding ({options.handshake})",
        unit="pairs",
        total=pairs,
        done=lambda figures: pairs * _sent(figures).delivered_bytes // max(size, 1),
        rate=lambda figures: _sent(figures).pairs_per_s,
        file=file,
    )


def _sent(figures: Figures) -> SentFigures:
    assert isinstance(figures, SentFigures)  # as this service's application reports
    return figures


def check_input(
    request: SuperdenseRequest, hosts: Sequence[str], dark: Collection[str] = ()
) -> int:
    """Return the size of the message; raise BadInput before anything is started."""
    options = request.options
    check_two_hosts(request.sender, request.receiver, hosts, dark, FROM_TO)
    size = message_size(request)
    limit = SIZE_LIMIT[options.handshake]
    if size > limit:
        raise BadInput(
            f"{size:,} bytes: with the handshake {options.handshake} at most {limit:,} can be "
            "sent" + ("; use --handshake framed" if options.handshake != "framed" else "")
        )
    check_network(request.network)
    check_ranges(request.run)
    check_ranges(options)
    check_coding(options)
    return size


def check_coding(options: SuperdenseOptions) -> None:
    """Raise BadInput for a code that frames are too long for, or none to interleave."""
    if options.interleave and options.fec == "none":
        raise BadInput("--interleave spreads the codewords of a code: choose one with --fec")
    pairs = frame_format(options).pairs(options.frame_bytes)
    if pairs > MAX_BLOCK_PAIRS:
        raise BadInput(
            f"--frame-bytes {options.frame_bytes} with --fec {options.fec}: a frame needs "
            f"{pairs:,} pairs, at most {MAX_BLOCK_PAIRS:,}; choose fewer bytes"
        )


def frame_format(options: SuperdenseOptions) -> FrameFormat:
    """Return what frames are made of, if the receiver tells all Bell states apart."""
    return FrameFormat(CODES[FEC_NAMES[options.fec]], options.interleave)


def pairs_of(options: SuperdenseOptions, size: int) -> int:
    """Return how many Bell pairs carry a message if none is lost and no frame repeated."""
    used = frame_format(options)
    frame_bytes: int = min(options.frame_bytes, CHUNK_BYTES[options.handshake])
    whole, rest = divmod(size, frame_bytes)
    return whole * used.pairs(frame_bytes) + used.pairs(rest)


def message_size(request: SuperdenseRequest) -> int:
    if request.message is not None:
        return len(request.message.encode())
    file = request.file or MESSAGE
    try:
        if file.exists() and not file.is_file() and not file.is_dir():
            raise BadInput(f"{file} is not a file with an end: save what it gives, and send that")
        with file.open("rb") as opened:
            return os.fstat(opened.fileno()).st_size
    except OSError as error:
        raise BadInput(f"cannot read {file}: {error.strerror}") from error


def tell_estimate(request: SuperdenseRequest, size: int, console: Console) -> None:
    """Say before the start how long a long message will take."""
    options = request.options
    pairs = pairs_of(options, size)
    expected = EXPECTED_RATE[options.handshake]
    expected = min(expected, DECODING_RATE.get(options.fec, expected), options.rate_hz)
    seconds = pairs / expected
    if seconds <= TELL_ESTIMATE_ABOVE_S:
        return
    text = f"{size:,} bytes are {pairs:,} Bell pairs: about {seconds / 60:.1f} minutes on two cores"
    if request.run.packet_bytes == MAX_PACKET_BYTES:
        text += f", and {captured_mb(options.handshake, pairs):,.0f} MB of captures"
        text += " (--captures headers or none saves these)"
    if request.run.record:
        recorded = pairs * RECORDED_BYTES_PER_PAIR[options.handshake] / 1e6
        text += f", {recorded:,.0f} MB of record (--without record saves these)"
    console.print(f"{text}; losses take more. Ctrl-C ends it cleanly.")


def captured_mb(handshake: str, pairs: int) -> float:
    """Return the bytes of `pairs` pairs in captures and, if it is made, in the timeline."""
    captured = pairs * CAPTURED_BYTES_PER_PAIR[handshake]
    merged = 0.0
    if captured <= MERGE_AT_MOST_BYTES:
        parts = MERGED if captured <= WHOLE_AT_MOST_BYTES else MERGED_HEADS
        merged = captured * parts[handshake]
    return (captured + merged) / 1e6
