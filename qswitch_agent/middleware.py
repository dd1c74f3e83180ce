"""The switch's middleware: which cross-connects the flow table asks for.

Light carries no headers. It meets, of the entries whose match asks for its port or for
nothing at all, the one with the highest priority; if that entry is a path
(in_port = one fibre port -> output: another), the hardware makes this cross-connect.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from qswitch_agent.hardware.optics import CrossConnect
from qswitch_agent.openflow import REMOVED, FlowEntry, FlowUpdate


@dataclass(frozen=True)
class Plan:
    """What the hardware shall do, and what of the table it cannot do."""

    cross_connects: frozenset[CrossConnect] = frozenset()
    conflicts: tuple[str, ...] = ()  # paths into a port that another path already ends in


class FlowTable:
    """The bridge's table 0, as its flow monitor reports it."""

    def __init__(self, fiber_ports: Iterable[int]) -> None:
        self._fiber_ports = frozenset(fiber_ports)
        self._cut: set[int] = set()
        self._entries: dict[tuple[int, bytes], FlowEntry] = {}

    def apply(self, update: FlowUpdate) -> None:
        """Take one event of the flow monitor into the table."""
        entry = update.entry
        if entry is None:
            return
        if update.event == REMOVED:
            self._entries.pop((entry.priority, entry.match), None)
        else:
            self._entries[entry.priority, entry.match] = entry

    def set_fiber(self, port: int, whole: bool) -> bool:
        """Note whether the fibre at a port is whole; tell whether that is news."""
        if port not in self._fiber_ports or whole != (port in self._cut):
            return False
        self._cut ^= {port}
        return True

    def is_foreign(self, update: FlowUpdate) -> bool:
        """Say whether this puts an entry on a fibre port that is not a path for light."""
        entry = update.entry
        return (
            entry is not None
            and update.event != REMOVED
            and entry.in_port in self._fiber_ports
            and self._path(entry) is None
        )

    def plan(self) -> Plan:
        """Return the cross-connects that the table asks for, between fibres that are whole.

        Two paths cannot end in one port: the higher priority has it, then the lower
        in_port; the other path is a conflict.
        """
        taken: dict[int, CrossConnect] = {}
        conflicts = []
        for entry in self._effective_entries():
            path = self._path(entry)
            if path is None or self._cut.intersection(path):
                continue
            first = taken.setdefault(path.out_port, path)
            if first != path:
                conflicts.append(
                    f"no path from port {path.in_port} to port {path.out_port}: "
                    f"the path from port {first.in_port} ends there"
                )
        return Plan(frozenset(taken.values()), tuple(conflicts))

    def _effective_entries(self) -> list[FlowEntry]:
        """Return, highest priority first, the entry that the light of each port meets."""
        met: dict[int, FlowEntry] = {}
        for entry in sorted(self._entries.values(), key=_precedence):
            if entry.other_fields:
                continue
            ports = self._fiber_ports if entry.in_port is None else {entry.in_port}
            for port in ports:
                met.setdefault(port, entry)
        return list(dict.fromkeys(met.values()))

    def _path(self, entry: FlowEntry) -> CrossConnect | None:
        ports = (entry.in_port, entry.out_port)
        if entry.other_fields or not self._fiber_ports.issuperset(ports):
            return None
        assert entry.in_port is not None
        assert entry.out_port is not None
        if entry.in_port == entry.out_port:
            return None
        return CrossConnect(entry.in_port, entry.out_port)


def _precedence(entry: FlowEntry) -> tuple[int, bool, int]:
    return (-entry.priority, entry.in_port is None, entry.in_port or 0)
