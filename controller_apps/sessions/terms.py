"""The settings of the run, and the policy in force, by which requests are decided."""

from collections.abc import Callable
from dataclasses import dataclass

from controller_apps.light.paths import Network
from controller_apps.packets import FiveTuple
from controller_apps.policy.policy import Filter, Policy
from controller_apps.sessions.admission import Admission, find_light
from controller_apps.sessions.sessions import Sessions
from wire.metadata.setup import Setup

UNFILTERED = Policy(filter=Filter(handshakes=False))  # where no switch reports handshakes


@dataclass
class Terms:
    """Read by all parts of the arbiter; the policy may be replaced at any time."""

    network: Network
    hold_timeout_s: float
    idle_timeout_s: float
    budget_mdb: int  # loss of one light path, in thousandths of a dB
    queues: bool  # whether a request waits for light that others have
    policy: Policy = UNFILTERED
    forbid: Callable[[Setup, FiveTuple], Admission | None] = lambda _setup, _connection: None

    def find_light(self, setup: Setup, connection: FiveTuple, sessions: Sessions) -> Admission:
        """Return light that these sessions leave free, or the reason that there is none."""
        taps = self.policy.taps
        return find_light(setup, connection, sessions, self.network, self.budget_mdb, taps)
