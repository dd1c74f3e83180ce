"""Table 0 as the bridge reports it, and what would become of it.

Of the entries whose match asks for its port or for nothing at all, light meets the one with
the highest priority; if that entry is a path (in_port = a port of light -> output: another),
the hardware makes this cross-connect.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from zlib import crc32

from qswitch_agent.hardware.optics import CrossConnect
from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import flows, matches, refusals
from qswitch_agent.openflow.flow_reports import REMOVED, FlowUpdate
from qswitch_agent.openflow.flows import FlowEntry, FlowMod
from qswitch_agent.openflow.instructions import Mark
from wire.parameters.switch import Kind, inner_port

ALL_TABLES = (0, ofp.OFPTT_ALL)
UNMARKED = 1 << 31  # circuits of entries that came past the agent


@dataclass(frozen=True)
class Plan:
    """The cross-connects for the hardware, and the entries that it cannot execute."""

    cross_connects: frozenset[CrossConnect] = frozenset()
    refused: Mapping[CrossConnect, str] = field(default_factory=dict)  # and why


class FlowTable:
    """The entries of table 0, which fibres are whole, and what is stuck."""

    def __init__(self, fiber_ports: Iterable[int], inner_ports: Iterable[int] = ()) -> None:
        """Light comes from fibres, memories and sources, and goes to fibres and to inner ports."""
        self.fibers, self.inner = frozenset(fiber_ports), frozenset(inner_ports)
        kinds = {port: inner_port(port).kind for port in self.inner}
        emitting = Kind.SOURCE, Kind.EMITTER
        self.sources = frozenset(port for port, kind in kinds.items() if kind in emitting)
        self.inputs = self.fibers | {p for p, kind in kinds.items() if kind != Kind.ANALYSER}
        self.light = self.fibers | self.inner  # where no packets go
        self.outputs = self.light - self.sources
        self.stuck: frozenset[tuple[int, int]] = frozenset()  # that cannot be changed
        self._cut: set[int] = set()
        self._entries: dict[tuple[int, bytes], FlowEntry] = {}
        self._marked: set[tuple[int, bytes]] = set()  # keys of the entries with a mark

    def copy(self) -> "FlowTable":
        other = FlowTable(self.fibers, self.inner)
        other.stuck = self.stuck
        other._cut = set(self._cut)
        other._entries = dict(self._entries)
        other._marked = set(self._marked)
        return other

    def apply(self, update: FlowUpdate) -> None:
        entry = update.entry
        if entry is None:
            return
        if update.event == REMOVED:
            self._remove(entry.key)
        else:
            self._put(entry)

    def _put(self, entry: FlowEntry) -> None:
        self._entries[entry.key] = entry
        light = entry.in_port in self.inputs and not entry.other_fields
        (self._marked.add if light and entry.mark else self._marked.discard)(entry.key)

    def _remove(self, key: tuple[int, bytes]) -> None:
        self._entries.pop(key, None)
        self._marked.discard(key)

    def marked(self) -> list[FlowEntry]:
        return [self._entries[key] for key in self._marked]

    def find(self, priority: int, match: bytes) -> FlowEntry | None:
        return self._entries.get((priority, match))

    def set_fiber(self, port: int, whole: bool) -> bool:
        """Note whether the fibre at a port is whole; tell whether that is news."""
        if port not in self.light or whole != (port in self._cut):
            return False
        self._cut ^= {port}
        return True

    def is_foreign(self, update: FlowUpdate) -> bool:
        """Say whether this puts an entry on a port of light that light can do nothing with."""
        entry = update.entry
        return (
            entry is not None
            and update.event != REMOVED
            and entry.in_port in self.inputs
            and not entry.other_fields
            and entry.mark is None
            and self._path(entry) is None
        )

    def change(self, mod: FlowMod) -> list[FlowMod]:
        """Execute a FLOW_MOD; return the messages by which the bridge does the same.

        MODIFY leaves time-outs and counters of an entry as they are. The mark that holds
        them is among the actions, so each light entry is modified by a message of its own.
        Raise Refusal if MODIFY would make something else of light entries.
        """
        if mod.table not in ALL_TABLES:
            return [mod]
        if mod.deletes:
            for entry in self._affected(mod):
                self._remove(entry.key)
            return [mod]
        if mod.command == ofp.OFPFC_ADD:
            self._put(flows.entry(mod.priority, mod.match, mod.instructions, mod.cookie))
            return [mod]
        return self._modify(mod)

    def _modify(self, mod: FlowMod) -> list[FlowMod]:
        affected = [e for e in self._affected(mod) if e.in_port in self.inputs]
        light = [entry for entry in affected if not entry.other_fields]
        if light and set(mod.fields) != {matches.IN_PORT}:
            raise refusals.bad_out_port(
                f"this would also modify the light of port {light[0].in_port}",
            )
        if not affected:
            return [mod]
        if len(light) < len(affected):
            raise refusals.bad_field(
                f"this would also modify what becomes of LLDP from port {affected[0].in_port}",
            )
        changed = [
            mod._replace(
                command=ofp.OFPFC_MODIFY_STRICT,
                priority=entry.priority,
                match=entry.match,
                cookie=entry.cookie,
            ).marked(entry.mark or Mark(0, 0))
            for entry in light
        ]
        for one in changed:
            self._put(flows.entry(one.priority, one.match, one.instructions, one.cookie))
        return changed

    def shows(self, mod: FlowMod) -> bool:
        """Tell whether the table is as a FLOW_MOD leaves it, with the mark that it was sent with.

        So it is no sooner than the bridge has reported what it did, or there was nothing to do.
        """
        if mod.table not in ALL_TABLES:
            return True
        if mod.deletes:
            return not self._affected(mod)
        entry = flows.entry(mod.priority, mod.match, mod.instructions, mod.cookie)
        return self._entries.get(entry.key) == entry

    def path_of(self, mod: FlowMod) -> CrossConnect | None:
        return self._path(flows.entry(mod.priority, mod.match, mod.instructions, mod.cookie))

    def _affected(self, mod: FlowMod) -> list[FlowEntry]:
        return [entry for entry in self._entries.values() if concerns(mod, entry)]

    def plan(self) -> Plan:
        """Return the cross-connects that the table asks for, between fibres that are whole.

        Two paths cannot end in one port: the higher priority has it, then the lower
        in_port. A stuck cross-connect keeps both its ports from all other paths.
        """
        taken: dict[int, CrossConnect] = {}
        refused = {}
        for entry in self._effective_entries():
            path = self._path(entry)
            if path is None or self._cut.intersection(path[:2]):
                continue
            reason = self._in_the_way(path) or _taken(path, taken.get(path.out_port))
            if reason:
                refused[path] = (
                    f"no path from port {path.in_port} to port {path.out_port}: {reason}"
                )
            else:
                taken[path.out_port] = path
        return Plan(frozenset(taken.values()), refused)

    def _in_the_way(self, path: CrossConnect) -> str:
        """Say which stuck cross-connect keeps a path from being made, empty if none does."""
        for in_port, out_port in sorted(self.stuck):
            if (in_port == path.in_port) != (out_port == path.out_port):
                return f"the cross-connect {in_port}->{out_port} is stuck"
        return ""

    def light_paths(self) -> dict[CrossConnect, FlowEntry]:
        """Return the paths that controllers have asked for, whether light meets them or not."""
        paths = ((self._path(entry), entry) for entry in self.marked())
        return {path: entry for path, entry in paths if path is not None}

    def _effective_entries(self) -> list[FlowEntry]:
        """Return, highest priority first, the entry that the light of each port meets."""
        met: dict[int, FlowEntry] = {}
        for entry in sorted(self._entries.values(), key=_precedence):
            if entry.other_fields:
                continue
            ports = self.inputs if entry.in_port is None else {entry.in_port}
            for port in ports:
                met.setdefault(port, entry)
        return list(dict.fromkeys(met.values()))

    def _path(self, entry: FlowEntry) -> CrossConnect | None:
        if entry.other_fields or entry.in_port is None or entry.out_port is None:
            return None
        if entry.in_port not in self.inputs or entry.out_port not in self.outputs:
            return None
        if entry.in_port == entry.out_port:
            return None
        return CrossConnect(entry.in_port, entry.out_port, circuit_of(entry))


def _taken(path: CrossConnect, first: CrossConnect | None) -> str:
    if first is None or first == path:
        return ""
    return f"the path from port {first.in_port} ends there"


def circuit_of(entry: FlowEntry) -> int:
    if entry.mark is not None and entry.mark.circuit:
        return entry.mark.circuit
    name = entry.cookie.to_bytes(8, "big") + entry.priority.to_bytes(2, "big") + entry.match
    return UNMARKED | crc32(name) & UNMARKED - 1


def concerns(mod: FlowMod, entry: FlowEntry) -> bool:
    if (entry.cookie ^ mod.cookie) & mod.cookie_mask:
        return False
    if mod.deletes and not _filters_pass(mod, entry):
        return False
    if not mod.strict:
        return not mod.fields or matches.covers(mod.fields, matches.parse(entry.match))
    return entry.priority == mod.priority and matches.parse(entry.match) == mod.fields


def _filters_pass(mod: FlowMod, entry: FlowEntry) -> bool:
    # No light entry has a group; what else has one makes no path.
    return mod.out_group == ofp.OFPG_ANY and mod.out_port in (ofp.OFPP_ANY, entry.out_port)


def _precedence(entry: FlowEntry) -> tuple[int, bool, int]:
    return (-entry.priority, entry.in_port is None, entry.in_port or 0)
