"""Options of GHZ states."""

from dataclasses import dataclass

from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.service_options import ServiceOptions
from wire.metadata.vocabulary import Reason

LEAST_HOSTS, MOST_HOSTS = 2, 16  # of two it is a Bell pair


@dataclass(frozen=True)
class GhzOptions(ServiceOptions):
    """`count` states of all hosts, measured to tell how good they are."""

    line: str = "alice,bob,charlie"  # hosts by their links: who asks, who is asked, others

    @property
    def names(self) -> list[str]:
        """Return the names of all hosts."""
        return self.line.split(",")

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        super().check()
        if not isinstance(self.line, str):
            raise SessionError(Reason.UNSUPPORTED, f"line {self.line!r}: write A,B,C")
        names = self.names
        if not LEAST_HOSTS <= len(set(names)) == len(names) <= MOST_HOSTS:
            text = f"line {self.line}: name {LEAST_HOSTS} to {MOST_HOSTS}, each once, as A,B,C"
            raise SessionError(Reason.UNSUPPORTED, text)
        if names[1] != self.host:
            text = f"line {self.line}: {self.host} is asked, so it has to be the second"
            raise SessionError(Reason.UNSUPPORTED, text)
