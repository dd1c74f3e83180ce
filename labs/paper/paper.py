"""The source paper's own figures: a handshake for each Bell state, and the traffic."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from subprocess import DEVNULL, check_output

from evidence.labs.lab import Finding, Lab, Runs, exactly
from qmn.results.timeline import TIMELINE
from views.report.handshake_diagram import handshake_diagram
from views.report.markup import STYLE, figure
from views.report.packets import flights
from views.report.run_facts import RunFacts, read_run
from views.report.sequence import Step, handshake, lanes
from views.report.streams import segments
from views.verbs.wireshark import installed_dissectors
from wire.dispatcher_pb2 import Event
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake

# The paper's table of encodings: bits, operator, Bell state.
TABLE = {"00": ("I", "Phi+"), "01": ("X", "Psi+"), "10": ("Z", "Phi-"), "11": ("XZ", "Psi-")}
MESSAGE = "N"  # 01 00 11 10: each of them once
ORDER = ("Setup", "open", "Answer", "apply", "bell-measure")


def findings(runs: Runs) -> Sequence[Finding]:
    """Return what of the paper's figures is seen in packets and events."""
    run = read_run(runs["handshakes"].folder)
    seen, bits = _seen(run.events), format(ord(MESSAGE), "08b")
    expected = [TABLE[bits[place : place + 2]] for place in range(0, 8, 2)]
    ordered = sum(_in_order(steps) for steps in _handshakes(run))
    spoken = {
        (segment.source, segment.target)
        for file in run.folder.glob("s1-eth*.pcap")
        for segment in segments(file)
    }
    address = run.network.addresses
    pairs = (("alice", "bob"), ("alice", "ed"), ("bob", "ed"), ("charlie", "ed"))
    there = sum((address[a], address[b]) in spoken for a, b in pairs)
    same = sum(one == other for one, other in zip(seen, expected, strict=True))
    opened = len({e.time_ns for e in run.events if e.kind == "open"})
    return [
        exactly("Bell states encoded and reported", same, 4, "table: bits, operator, Bell state"),
        exactly("light paths opened for them", opened, 4, "section 4: the protocol is repeated"),
        exactly("handshakes in the order drawn", ordered, 4, "figure: handshaking"),
        exactly("pairs of nodes seen talking", there, 4, "figure: Wireshark"),
        exactly("messages that came", int(run.result.delivered), 1, "section 4"),
    ]


def _seen(events: Sequence[Event]) -> list[tuple[str, str]]:
    """Return what was done to each pair, and which Bell state was found: X and Psi+."""
    reports = {
        kind: [e.detail.rpartition(": ")[2].partition("=")[0] for e in events if e.kind == kind]
        for kind in ("apply", "bell-measure")
    }
    return list(zip(*reports.values(), strict=True))


def _handshakes(run: RunFacts) -> Iterator[list[Step]]:
    """Yield the steps from each set-up of one Bell state to the next."""
    port = run.result.settings.openflow_port
    begun = [
        flight.left_ns
        for flight in flights(run.folder, run.network, 1000)
        if isinstance(flight.message, Setup) and flight.message.handshake == Handshake.ONE_PAIR
    ]
    for begin, end in zip(begun, [*begun[1:], 1 << 63], strict=True):
        steps, _more = handshake(run.folder, run.network, run.events, port, begin)
        yield [step for step in steps if step.time_ns < end]


def _in_order(steps: Sequence[Step]) -> bool:
    first = [next((s.time_ns for s in steps if f" {word}" in f" {s.text}"), 0) for word in ORDER]
    return all(first) and first == sorted(first)


def files(runs: Runs, folder: Path) -> Sequence[Path]:
    """Write the handshakes as a page, and the traffic as Wireshark shows it."""
    run = read_run(runs["handshakes"].folder)
    page, traffic = folder / "handshakes.html", folder / "wireshark.txt"
    drawn = "".join(
        figure(f"{done}: {state}", handshake_diagram(s, lanes(s, run.network)), "", "wide")
        for (done, state), s in zip(_seen(run.events), _handshakes(run), strict=True)
    )
    page.write_text(f"<meta charset=utf-8><style>{STYLE.read_text()}</style>{drawn}")
    alice = f"ip.addr == {run.network.addresses['alice']} && tcp"
    command = ["tshark", "-X", f"lua_script:{installed_dissectors()}", "-r", TIMELINE, alice]
    traffic.write_bytes(check_output(command, cwd=run.folder, stderr=DEVNULL))
    return page, traffic


LAB = Lab(
    title="the source paper's figures: a handshake for each Bell state, seen in Wireshark",
    paper="Dasari, Sadlier, Prout, Williams, Humble (2016), arXiv:1604.01276",
    runs={"handshakes": f"run sdc --handshake sequential --message {MESSAGE} --without report"},
    findings=findings,
    files=files,
)
