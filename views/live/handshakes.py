"""The newest handshake and photons of a run, drawn as its report draws the first ones."""

from pathlib import Path

from qmn.requests.service_verbs import VERBS, services_of
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.events.event_sources import recorded
from views.report.first_photons import first_photons
from views.report.packets import messages
from views.report.sequence import handshake, lanes
from wire.controller_lines import read_record
from wire.metadata.setup import Setup
from wire.parameters.network import OPENFLOW_PORT
from wire.results.run_result import NetworkFacts

KEY_SERVICES = frozenset(
    service
    for name, verb in VERBS.items()
    if verb.keys and not verb.line
    for service in services_of(name)
)


def newest_setup_ns(folder: Path, network: NetworkFacts) -> int:
    """Return when the newest session was first asked for, 0 if the captures hold none."""
    first_ns: dict[int, int] = {}
    for file in folder.glob("*.pcap"):
        if network.host_at(file.stem) in network.addresses:
            for time_ns, _flow, _sequence, message in messages(file):
                if isinstance(message, Setup):
                    first_ns[message.session] = min(time_ns, first_ns.get(message.session, time_ns))
    return max(first_ns.values(), default=0)


def drawn_handshake(folder: Path, network: NetworkFacts) -> str:
    """Return an element of the page: the drawing, or in its place what is missing."""
    # matplotlib takes half a second to load: a page begins without it.
    from views.report.handshake_diagram import handshake_diagram

    since_ns = newest_setup_ns(folder, network)
    if not since_ns:
        return "<p>No set-up has been captured (in <code>qmn cli</code>: --captures full).</p>"
    capture = folder / EVENT_CAPTURE
    events = [
        event
        for event in (recorded(capture, follow=False) if capture.exists() else ())
        if event.time_ns >= since_ns and not event.photon
    ]
    steps, _more = handshake(folder, network, events, OPENFLOW_PORT, since_ns)
    return handshake_diagram(steps, lanes(steps, network))


def newest_photons(folder: Path) -> str:
    """Return the table of the newest session of a key; "" if none has measured light yet."""
    capture = folder / EVENT_CAPTURE
    events = [e for e in recorded(capture, follow=False) if e.first] if capture.exists() else []
    for fact in reversed(read_record(folder)):
        if fact["event"] == "granted" and fact["service"] in KEY_SERVICES:
            session = int(fact["session"], 16)
            of_session = [event for event in events if event.block.session == session]
            if made := first_photons(of_session, (fact["from"], fact["to"])):
                return made
    return ""
