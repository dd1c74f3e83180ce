"""Commands to hosts about link monitors, and questions about sessions: sent until answered."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from controller_apps.devices.hosts_state import Place
from controller_apps.openflow.framework import Event
from controller_apps.sessions.actions import Command, HostCommand
from controller_apps.timeouts import NODE_TIMEOUT_S
from wire.device import DeviceReport, SessionQuery
from wire.metadata.vocabulary import Reason
from wire.monitor_messages import SessionEstimate


class EventCommand(Event):
    def __init__(self, command: Command) -> None:
        super().__init__()
        self.command = command


class EventNodeAnswered(Event):
    """A host has answered its command for a link monitor."""

    def __init__(self, session: int, node: str, reason: Reason) -> None:
        super().__init__()
        self.session, self.node, self.reason = session, node, reason


class EventSessionReported(EventNodeAnswered):
    """A host has reported whether it takes part in a session."""


class EventAlarm(Event):
    """A link monitor of a host has found an eavesdropper."""

    def __init__(self, session: int, host: str, place: Place) -> None:
        super().__init__()
        self.session, self.host, self.place = session, host, place


class EventMonitorOver(Event):
    def __init__(self, host: str, address: str, report: DeviceReport) -> None:
        super().__init__()
        self.host, self.address, self.report = host, address, report


class EventEstimate(Event):
    def __init__(self, host: str, address: str, estimate: SessionEstimate) -> None:
        super().__init__()
        self.host, self.address, self.estimate = host, address, estimate


@dataclass
class HostCommands:
    """The commands without an answer, by the node's address and number."""

    _waiting: dict[tuple[str, int], tuple[HostCommand, float]] = field(default_factory=dict)

    def add(self, node: str, command: HostCommand, now: float) -> None:
        self._waiting[node, command.session] = command, now + NODE_TIMEOUT_S

    def answered(self, node: str, number: int) -> HostCommand | None:
        """Send it no more; return which one it was, None if it was not one."""
        command, _until = self._waiting.pop((node, number), (None, 0.0))
        return command

    def due(self) -> Iterator[tuple[str, HostCommand]]:
        for (node, _number), (command, _until) in list(self._waiting.items()):
            yield node, command

    def give_up(self, now: float) -> list[tuple[str, HostCommand]]:
        """Drop and return what has not been answered in time."""
        late = [key for key, (_command, until) in self._waiting.items() if until <= now]
        return [(node, self._waiting.pop((node, number))[0]) for node, number in late]


def session_of(command: HostCommand) -> int:
    return command.about if isinstance(command, SessionQuery) else command.monitor
