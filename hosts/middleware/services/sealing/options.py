"""Options of a tamper seal."""

from dataclasses import dataclass

from hosts.middleware.services.sealing.sequential_test import Question
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.service_options import ServiceOptions
from wire.metadata import Reason

RANGES = {
    "whole_error": (1e-6, 0.2),
    "fraction": (0.001, 1.0),
    "false_alarm": (1e-15, 0.1),
    "missed": (1e-15, 0.1),
}


@dataclass(frozen=True)
class SealOptions(ServiceOptions):
    """Watch with `count` pairs that are compared, or until an alarm."""

    count: int = 10_000
    block_pairs: int = 1024
    rate_hz: int = 100_000
    whole_error: float = 0.01  # part of the pairs that differ though nobody is there, at most
    fraction: float = 0.25  # of the photons that an intruder measures, who is to be found
    false_alarm: float = 1e-6  # of a test, at most
    missed: float = 0.01  # that a test takes such an intruder for nobody, at most

    @property
    def question(self) -> Question:
        """Return what the tests are to tell apart."""
        return Question(self.whole_error, self.fraction, self.false_alarm, self.missed)

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        super().check()
        for name, (least, most) in RANGES.items():
            value = getattr(self, name)
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not number or not least <= value <= most:
                text = f"{name} is {value!r}: choose {least:g} to {most:g}"
                raise SessionError(Reason.UNSUPPORTED, text)
