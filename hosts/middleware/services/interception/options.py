"""Options of an interception."""

from dataclasses import dataclass

from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import Options, check_choice, check_whole
from wire.metadata import Reason, Setup
from wire.optical import WAVELENGTHS_PM

MAX_DB = 1_000.0
RESEND, SPLIT = ATTACKS = ("resend", "split")


@dataclass(frozen=True)
class InterceptionOptions(Options):
    """What an application chooses."""

    fraction: float = 1.0  # of the photons; the others are only sent on
    attack: str = RESEND
    # Of splitting: what light loses from here to a click, as both ends expect it, and as it is.
    expected_db: float = 0.0
    onward_db: float = 0.0
    wavelength_pm: int = Setup.wavelength_pm  # at which light is sent on

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        check_choice("attack", self.attack, ATTACKS)
        for name, most in (("fraction", 1), ("expected_db", MAX_DB), ("onward_db", MAX_DB)):
            value = getattr(self, name)
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not number or not 0 <= value <= most:
                raise refused(f"{name} is {value!r}: choose 0 to {most:g}")
        check_whole("wavelength_pm", self.wavelength_pm, *WAVELENGTHS_PM)
        if self.attack == SPLIT and self.fraction != 1:
            raise refused(f"fraction is {self.fraction!r}: {SPLIT} is of every pulse, choose 1")
        if self.attack == RESEND and (self.expected_db or self.onward_db):
            raise refused(f"expected_db and onward_db are of {SPLIT}: leave them out")
        if self.onward_db > self.expected_db:
            raise refused(
                f"onward_db is {self.onward_db!r}, more than expected_db {self.expected_db!r}: "
                "who attacks so has a better way, not a worse one"
            )


def refused(text: str) -> SessionError:
    """Return the refusal of what was asked."""
    return SessionError(Reason.UNSUPPORTED, text)
