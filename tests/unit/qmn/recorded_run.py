"""A small run as programs leave it: captures, events, records, result."""

import json
import struct
from dataclasses import fields
from pathlib import Path
from typing import Any, cast

from scapy.layers.inet import IP, TCP
from scapy.layers.l2 import Ether
from scapy.utils import PcapWriter

from dispatcher.layer.history import EventCapture
from hosts.applications.carrying import sent_figures
from qmn.requests.kinds import RECORDED_REQUESTS
from qmn.requests.request import Request
from qmn.results.result import complete
from qmn.results.run_result import RunResult
from wire.config import PathOptics, QuantumSwitch
from wire.controller_lines import RECORD
from wire.dispatcher_pb2 import BlockId, Event
from wire.metadata.header import TO_SWITCHES
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Handshake, Reason, Service, Verdict
from wire.parameters.fiber import Fiber, FiberEnd, FiberOptics
from wire.parameters.physics import Detectors, Device
from wire.results.figures import (
    Figures,
    ReceiverFigures,
    SenderFigures,
    SentFigures,
    TeleportFigures,
)
from wire.results.run_result import Approximated, Message, NetworkFacts, ServiceJob

START_NS = 1_700_000_000 * 10**9
SESSION = 0xABC
MS = 1_000_000
SETUP = Setup(SESSION, Service.SDC, Handshake.FRAMED, "10.0.0.3", 400, 256, 50_000_000)
GRANTED = Setup(**{**vars(SETUP), "verdict": Verdict.GRANTED})
ANSWER = Answer(SESSION, Reason.OK, "", 4, SETUP.encoding)
ALICE, BOB = ("10.0.0.1", 40_000), ("10.0.0.2", 9010)
NETWORK = NetworkFacts(
    {"alice": "10.0.0.1", "bob": "10.0.0.2", "charlie": "10.0.0.3"},
    "charlie",
    [
        Fiber(FiberEnd("alice", "alice-q0"), FiberEnd("q1", "2"), length_km=5, loss_db_per_km=0.2),
        Fiber(FiberEnd("q1", "3"), FiberEnd("q2", "1"), length_km=10, loss_db_per_km=0.2),
        Fiber(FiberEnd("bob", "bob-q0"), FiberEnd("q2", "2"), connectors_db=0.5),
        Fiber(FiberEnd("charlie", "charlie-q0"), FiberEnd("q2", "3")),
    ],
    [
        QuantumSwitch("q1", insertion_loss_db=0.7),
        QuantumSwitch("q2", insertion_loss_db=9.0, paths=[PathOptics(1, 2, 0.3)]),
    ],
    [
        ["s1", "s1-eth1", "alice", "alice-eth0"],
        ["s1", "s1-eth2", "bob", "bob-eth0"],
        ["s1", "s1-eth3", "charlie", "charlie-eth0"],
    ],
    copper_switches=["s1"],
)


def segment(ends: tuple[tuple[str, int], tuple[str, int]], sequence: int, data: bytes) -> bytes:
    (source, source_port), (target, target_port) = ends
    tcp = TCP(sport=source_port, dport=target_port, seq=sequence, flags="PA")
    return bytes(Ether(src="02:00:00:00:00:01") / IP(src=source, dst=target) / tcp / data)


def capture(file: Path, packets: list[tuple[int, bytes]]) -> None:
    """Write packets, each with its nanoseconds since the start."""
    with PcapWriter(str(file), linktype=1, nano=True) as writer:
        writer.write_header(None)
        for offset_ns, data in packets:
            seconds, nanoseconds = divmod(START_NS + offset_ns, 10**9)
            writer.write_packet(data, sec=seconds, usec=nanoseconds, caplen=len(data))


def openflow(kind: int, body: bytes = b"") -> bytes:
    return struct.pack("!BBHI", 5, kind, 8 + len(body), 7) + body


def captures(folder: Path) -> None:
    """A set-up that the controller holds for 4 ms while it programs q1, and its answer."""
    there, back = (ALICE, BOB), (BOB, ALICE)
    setup, granted = SETUP.encode(), GRANTED.encode()
    at_alice = [(0, segment(there, 1, setup)), (2 * MS, segment(there, 1, setup))]  # sent again
    capture(folder / "s1-eth1.pcap", [*at_alice, (6 * MS, segment(back, 1, ANSWER.encode()))])
    first, second = ANSWER.encode()[:9], ANSWER.encode()[9:]
    answer = [(5 * MS, segment(back, 1, first)), (5 * MS + 1, segment(back, 10, second))]
    capture(folder / "s1-eth2.pcap", [(4 * MS, segment(there, 1, granted)), *answer])
    copy = TO_SWITCHES + b"frame" + setup
    classical, quantum, controller = (("127.0.0.1", port) for port in (50_001, 50_002, 6653))
    capture(
        folder / "c0.pcap",
        [
            (1, segment((controller, classical), 1, openflow(14))),
            (MS, segment((classical, controller), 1, openflow(10, b"frame" + setup))),
            (MS + 1, segment((quantum, controller), 1, openflow(10, copy))),
            (2 * MS, segment((controller, quantum), 1, openflow(14) + openflow(20))),
            (3 * MS, segment((quantum, controller), 1 + len(openflow(10, copy)), openflow(21))),
            (4 * MS - 1, segment((controller, classical), 9, openflow(13, b"frame" + granted))),
        ],
    )


def events() -> list[Event]:
    """Light for a block of 100: from charlie to alice there is no path, to bob there is."""
    halves = [BlockId(session=SESSION, number=1, half=half) for half in (0, 1)]

    def event(offset_ns: int, node: str, kind: str, **fields: Any) -> Event:
        return Event(time_ns=START_NS + offset_ns, node=node, kind=kind, **fields)

    measured = {"block": halves[0], "photons": 100, "lost": 40}
    return [
        event(2 * MS, "q1", "open", port="2", detail="2 -> 3"),
        event(2 * MS, "q2", "open", port="1", detail="1 -> 2"),
        event(3 * MS, "alice", "create", block=halves[0], photons=100),
        event(3 * MS, "alice", "send", block=halves[0], port="alice-q0", photons=100),
        event(4 * MS, "bob", "arrive", block=halves[0], port="bob-q0", photons=100, lost=40),
        event(5 * MS, "bob", "bell-measure", detail="with 1/1: Phi+=60", **measured),
        event(7 * MS, "q1", "close", port="2", detail="2 -> 3"),
    ]


CONFUSION = [[20, 1, 0, 0], [0, 15, 0, 0], [0, 0, 12, 0], [2, 0, 0, 10]]


def record_run(folder: Path, captured: bool = True, delivered: bool = True) -> Path:
    """Write a run into a folder and return that."""
    if captured:
        captures(folder)
    with (folder / "quantum.pcapng").open("wb") as opened:
        EventCapture(opened, NETWORK.fibers).record(*events())
    times = [
        {"time_ns": START_NS + MS, "event": "path_ready", "setup_ms": time, "packet_in_count": 1}
        for time in (2.5, 3.5)
    ]
    (folder / RECORD).write_text("".join(json.dumps(line) + "\n" for line in times))
    counts = {"bell_pairs": 100, "lost_pairs": 40, "symbol_errors": 3, "received_symbols": 60}
    report = sent(**counts, repeated_frames=1, symbols=4)
    done = {"event": "done", **vars(report)}
    (folder / "asking.log").write_text(f"{json.dumps({'event': 'report'})}\n{json.dumps(done)}\n")
    facts = message_run(folder, b"two bits" if delivered else b"", report, received(CONFUSION))
    facts.topology = "chain"
    facts.parameters = asked("sdc", {"receiver": "bob", "fec": "none <&>"}, "chain")
    facts.every_fiber = FiberOptics(length_km=5.0)
    facts.devices = {"every": Device(), "bob": Device(detectors=Detectors(efficiency=0.8))}
    facts.exact = False
    facts.approximations = [Approximated("one thing", 0.19471), Approximated("another", 0.5)]
    facts.network = NETWORK
    complete(facts, folder)
    return folder


def message_run(
    folder: Path,
    received: bytes | None,
    asking: SentFigures | None = None,
    asked: ReceiverFigures | None = None,
    time_scale: float = 1.0,
) -> RunResult:
    """Return what is known of a run that brings b"two bits", before its result is complete."""
    message = folder / "message"
    message.write_bytes(b"two bits")
    if received is not None:
        (folder / "received").write_bytes(received)
    job = ServiceJob(
        asking=asking or Figures(), asked=asked or Figures(), message=Message(str(message), 8)
    )
    return run_of("sdc", job, time_scale)


def sent(elapsed_s: float = 0.01, **report: Any) -> SentFigures:
    """Return the figures of who sends, but for those that are given that of nothing sent."""
    names = [each.name for each in fields(cast("Any", SenderFigures))]
    return sent_figures({**dict.fromkeys(names, 0), **report}, elapsed_s)


def received(confusion: list[list[int]]) -> ReceiverFigures:
    """Return the figures of who receives, but for the confusion those of nothing received."""
    names = [each.name for each in fields(cast("Any", ReceiverFigures))]
    reports: dict[str, Any] = {**dict.fromkeys(names, 0), "confusion": confusion}
    return ReceiverFigures(**reports)


def service_run(figures: Figures | None = None, service: str = "teleport") -> RunResult:
    """Return the record of a run of a service whose ends have printed this."""
    job = ServiceJob()
    job.asking = job.asked = cast("Any", figures or Figures())
    return run_of(service, job, 1.0)


def teleported(**report: Any) -> TeleportFigures:
    """Return the figures of 80 states, but for those that are given."""
    known = {"states": 80, "arrived": 80, "fidelity": 1.0, "fidelity_error": 0.0}
    known |= {"waited_ms": 0.1, "elapsed_s": 2.0, "states_per_s": 40.0}
    return TeleportFigures(**(known | report))


def asked(job: str, parameters: dict[str, Any], topology: str = "sdc") -> Request:
    """Return a request as a result that keeps these parameters has it."""
    return RECORDED_REQUESTS[job].read(parameters, topology=topology)


def run_of(service: str, job: ServiceJob, time_scale: float) -> RunResult:
    """Return what is known of a run between alice and bob."""
    return RunResult(
        service=service,
        hosts=["alice", "bob"],
        topology="sdc",
        mode="native",
        controller="ryu",
        seed=1,
        parameters=asked(service, {"receiver": "bob"}),
        backend="chp",
        time_scale=time_scale,
        job=job,
    )
