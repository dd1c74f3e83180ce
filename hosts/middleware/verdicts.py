"""The set-up messages that a host takes part in: those whose verdict the controller has sealed.

A host with standing light also takes those that no controller has arbitrated: the paths are
there already, and do not rotate. A verdict that there is must be sealed all the same.
"""

from dataclasses import dataclass, field, replace

from hosts.middleware.session.errors import SessionError
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Verdict
from wire.outcomes import Pauli
from wire.verdict import Connection, is_sealed

MAX_REMEMBERED = 4096


@dataclass
class Verdicts:
    """Checks verdicts of the controller, each of which counts once."""

    key: str  # the device key, hexadecimal; empty: no controller can grant this host anything
    standing: bool = False  # light stands without a grant
    _taken: dict[bytes, None] = field(default_factory=dict)  # seals, the oldest first

    def checked(self, setup: Setup, connection: Connection) -> Setup:
        """Return the set-up as it was decided on.

        Raise SessionError unless the controller has written this verdict for the connection.
        """
        verdict = Verdict(setup.verdict)
        if verdict == Verdict.PENDING and self.standing:
            wavelength_pm = setup.wavelength_pm or Setup.wavelength_pm
            granted = replace(setup, verdict=Verdict.GRANTED, wavelength_pm=wavelength_pm)
            return replace(granted, rotation=Pauli.I)
        if verdict == Verdict.PENDING:
            raise SessionError(Reason.NOT_ARBITRATED)
        if not self.key or not is_sealed(setup.encode(), self.key, connection):
            text = (
                f"the verdict {verdict.name} does not carry the controller's seal: is it made up, "
            )
            text += "or have host and controller different device keys?"
            raise SessionError(Reason.NOT_ARBITRATED, text)
        if setup.seal in self._taken:
            text = f"this verdict {verdict.name} has come before: was it sent again?"
            raise SessionError(Reason.NOT_ARBITRATED, text)
        if len(self._taken) >= MAX_REMEMBERED:
            del self._taken[next(iter(self._taken))]
        self._taken[setup.seal] = None
        return setup
