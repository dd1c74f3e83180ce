"""The steps of a handshake in both layers: what was sent by whom to whom, and when.

All times are on one clock: that of the captures, to which the dispatcher's is anchored.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, islice
from pathlib import Path
from types import MappingProxyType

from views.report.packets import Flight, flights, holds_setup, openflow
from views.report.places import columns
from views.report.streams import Flow
from wire.dispatcher_pb2 import Event
from wire.metadata.blocks import Block, Emission, Emit, Emitted, Finish, Report
from wire.metadata.header import TO_SWITCHES, Message
from wire.metadata.setup import Answer, Setup
from wire.metadata.values import Envelope, Topic, Values
from wire.metadata.vocabulary import FEC_NAMES, Reason, Service, Verdict
from wire.results.run_result import NetworkFacts

METADATA, OPENFLOW, QUANTUM = "metadata", "openflow", "quantum"
CONTROLLER = "c0"
UNKNOWN = "unknown"  # a switch of a network that names none
CODED = (Service.SDC, Service.PAIR_SOURCE)
MAX_MOMENTS = 64
MAX_EVENTS = 200  # looked at: more than can be shown
BARRIER, BARRIER_REPLY = 20, 21  # types of OpenFlow messages
HOLDING = (10, 13)  # packet-in and packet-out
PROGRAMMING = MappingProxyType({14: "FLOW_MOD", 34: "bundled FLOW_MOD"})
Spoken = tuple[int, Flow, bytes]


@dataclass(frozen=True)
class Step:
    """Something at one node, or on its way from one to another."""

    layer: str
    lane: str
    time_ns: int
    text: str
    to_lane: str = ""
    arrival_ns: int | None = None

    @property
    def moments(self) -> int:
        return 2 if self.arrival_ns is not None else 1


def together(steps: Iterable[Step]) -> list[Step]:
    joined: list[Step] = []
    for (step, text), same in groupby(steps, lambda each: (replace(each, text=""), _kind(each))):
        texts = [each.text for each in same]
        if len(set(texts)) > 1:  # ways through a switch
            text_of_all = text + ", ".join(each.removeprefix(text) for each in texts)
        else:
            text_of_all = texts[0] + (f" × {len(texts)}" if len(texts) > 1 else "")  # noqa: RUF001
        joined.append(replace(step, text=text_of_all))
    return joined


def _kind(step: Step) -> str:
    if step.layer == QUANTUM and not step.to_lane and "→" in step.text:
        return "".join(f"{word} " for word in step.text.split()[:2])  # as q1 open
    return step.text


def handshake(
    folder: Path,
    network: NetworkFacts,
    events: Sequence[Event],
    openflow_port: int,
    since_ns: int = 0,
) -> tuple[list[Step], int]:
    """Return the steps of a run from its first set-up behind a time on, and how many followed."""
    seen = flights(folder, network, 2 * MAX_MOMENTS, since_ns)
    steps = [_metadata_step(flight) for flight in seen]
    begin = min((step.time_ns for step in steps), default=0)
    end = max((step.arrival_ns or step.time_ns for step in steps), default=1 << 63)
    within = (event for event in events if begin <= event.time_ns <= end)
    steps += _quantum_steps(list(islice(within, MAX_EVENTS)), network)
    capture = folder / f"{CONTROLLER}.pcap"
    if seen and capture.exists():
        spoken = list(_between(openflow(capture, openflow_port), begin, end))
        steps += _openflow_steps(spoken, openflow_port, network)
    steps = together(sorted(steps, key=lambda step: step.time_ns))
    moments, shown = 0, 0
    for step in steps:
        if moments + step.moments > MAX_MOMENTS:
            break
        moments, shown = moments + step.moments, shown + 1
    return steps[:shown], len(steps) - shown


def lanes(steps: Iterable[Step], network: NetworkFacts) -> list[str]:
    """Return the nodes that take part: hosts as they are drawn, but a source second; switches."""
    used = {lane for step in steps for lane in (step.lane, step.to_lane) if lane}
    hosts = [name for column in columns(network) for name in column if name in network.addresses]
    if network.source in hosts[1:]:
        hosts.remove(network.source)
        hosts.insert(1, network.source)
    order = [*hosts, copper_lane(network), CONTROLLER]
    return [*(lane for lane in order if lane in used), *sorted(used - set(order))]


def switches_lane(network: NetworkFacts) -> str:
    return _lane_of([switch.name for switch in network.switches])


def copper_lane(network: NetworkFacts) -> str:
    return _lane_of(network.copper_switches)


def _lane_of(names: Sequence[str]) -> str:
    return " … ".join(dict.fromkeys((names[0], names[-1]))) if names else UNKNOWN


def _metadata_step(flight: Flight) -> Step:
    text = describe(flight.message)
    return Step(METADATA, flight.sender, flight.left_ns, text, flight.receiver, flight.arrived_ns)


def describe(message: Message) -> str:
    by_kind: dict[type[Message], Callable[..., str]] = {
        Setup: _describe_setup,
        Answer: lambda m: f"Answer {Reason(m.reason).name}",
        Emit: lambda m: f"Emit {_count(m.pairs, 'pair')}",
        Emission: lambda m: f"Emission of {_count(m.pairs, 'pair')}",
        Emitted: lambda m: f"Emitted? up to block {m.block}",
        Block: lambda m: f"Block {m.block}: {_count(m.pairs, 'pair')}",
        Report: lambda m: f"Report {m.block}: {m.lost:,} lost, {_count(m.errors, 'error')}",
        Finish: lambda m: f"Finish {_count(m.size, 'byte')}",
        Values: lambda m: f"Values {_topic(m.topic)} of block {m.block}: {m.count:,}",
        Envelope: lambda m: f"Envelope {_topic(m.topic)}, {_count(len(m.content), 'byte')}",
    }
    return by_kind[type(message)](message)


def _topic(number: int) -> str:
    return Topic(number).name if number in Topic.__members__.values() else str(number)


def _count(number: int, what: str) -> str:
    return f"{number:,} {what}" + ("" if number == 1 else "s")


def _describe_setup(setup: Setup) -> str:
    codes = {int(number): name for name, number in FEC_NAMES.items()}
    service = Service(setup.service).name.replace("_", " ")
    code = f", code {codes.get(setup.fec, setup.fec)}" if setup.service in CODED else ""
    text = f"Setup {service}{code}"
    return text if setup.verdict == Verdict.PENDING else f"{text}: {Verdict(setup.verdict).name}"


def _quantum_steps(events: Sequence[Event], network: NetworkFacts) -> Iterator[Step]:
    """Yield light as it travels, from its sending to its arrival, and what is done to it."""
    switches = {switch.name for switch in network.switches}
    parts = {part for switch in network.switches for part in switch.inner_devices}
    landings = [event for event in events if event.kind == "arrive"]

    def lane(event: Event) -> str:
        return switches_lane(network) if event.node in switches | parts else event.node

    for event in events:
        if event.kind == "send":
            landing = next((each for each in landings if _follows(event, each)), None)
            if landing is not None:
                landings.remove(landing)
                text = _count(event.photons, "photon") + _lost(landing)
                if lane(landing) == lane(event):
                    text = f"{event.node}→{landing.node} {text}"
                    yield Step(QUANTUM, lane(event), event.time_ns, text)
                else:
                    end, end_ns = lane(landing), landing.time_ns
                    yield Step(QUANTUM, lane(event), event.time_ns, text, end, end_ns)
                continue
        if event.kind != "arrive":
            yield Step(QUANTUM, lane(event), event.time_ns, _describe_event(event, switches, parts))
    for event in landings:
        text = f"arrive {event.photons:,}{_lost(event)}"
        yield Step(QUANTUM, lane(event), event.time_ns, text)


def _follows(sending: Event, landing: Event) -> bool:
    return bool(
        landing.block == sending.block
        and landing.time_ns >= sending.time_ns
        and landing.node != sending.node
    )


def _lost(event: Event) -> str:
    return f", {event.lost:,} lost" if event.lost else ""


def _describe_event(event: Event, switches: set[str], parts: set[str]) -> str:
    if event.node in switches:
        return f"{event.node} {event.kind} {event.detail.replace(' -> ', '→')}"
    who = f"{event.node} " if event.node in parts else ""
    lost = "" if event.kind == "bell-measure" else _lost(event)  # there of one half alone
    counts = f" {event.photons:,}{lost}" if event.photons else ""
    outcomes = event.detail.partition(": ")[2] if event.kind == "bell-measure" else ""
    return f"{who}{event.kind}{counts}{' ' if outcomes else ''}{outcomes}"


def _openflow_steps(spoken: Sequence[Spoken], port: int, network: NetworkFacts) -> Iterator[Step]:
    """Yield packets with set-up messages, and what programs quantum switches.

    The connections that set-ups come in on are those of classical switches; a path is
    programmed on the others.
    """
    copper, switches = copper_lane(network), switches_lane(network)
    held = [each for each in spoken if _holds(each[2])]
    classical = {_switch_port(flow, port) for _time_ns, flow, _data in held}
    programmed: set[int] = set()
    for time_ns, flow, data in spoken:
        kind, up, switch_port = data[1], flow.target_port == port, _switch_port(flow, port)
        if kind in HOLDING and TO_SWITCHES in data:
            if holds_setup(data):
                yield Step(OPENFLOW, switches, time_ns, "packet-in: set-up seen", CONTROLLER)
        elif _holds(data):
            text = "packet-in: set-up held" if up else "packet-out: set-up released"
            ends = (copper, CONTROLLER) if up else (CONTROLLER, copper)
            yield Step(OPENFLOW, ends[0], time_ns, text, ends[1])
        elif switch_port in classical:
            continue
        elif kind in PROGRAMMING and not up:
            programmed.add(switch_port)
            yield Step(OPENFLOW, CONTROLLER, time_ns, PROGRAMMING[kind], switches)
        elif kind == BARRIER and not up and switch_port in programmed:
            yield Step(OPENFLOW, CONTROLLER, time_ns, "barrier", switches)
        elif kind == BARRIER_REPLY and up and switch_port in programmed:
            yield Step(OPENFLOW, switches, time_ns, "barrier reply: path ready", CONTROLLER)


def _holds(data: bytes) -> bool:
    """Return whether a message of OpenFlow holds a set-up; copies for quantum switches apart."""
    return data[1] in HOLDING and holds_setup(data) and TO_SWITCHES not in data


def _switch_port(flow: Flow, port: int) -> int:
    return flow.source_port if flow.target_port == port else flow.target_port


def _between(spoken: Iterable[Spoken], begin_ns: int, end_ns: int) -> Iterator[Spoken]:
    """Yield the messages of a span of time; captures are in time order, or nearly so."""
    for each in spoken:
        if each[0] > end_ns:
            return
        if each[0] >= begin_ns:
            yield each
