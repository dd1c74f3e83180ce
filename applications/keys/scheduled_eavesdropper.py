"""--eve FRACTION --at S --until S: an eavesdropper who comes to the fibre of a run, and leaves.

The policy of the controller puts her on the fibre and takes her off again, as
`qmn set policy reload` would; sessions that are open stay as they are.
"""

import math
from collections.abc import Collection
from pathlib import Path

from applications.keys.request import EveSchedule
from applications.keys.time_series import TimeSeries
from qmn.jobs import eavesdropping
from qmn.jobs.policies import tapping_policy, write_policy
from qmn.network.description import NetworkDescription
from qmn.options import BadInput, check_ranges
from qmn.running.controller_console import ask
from qmn.timeouts import START_TIMEOUT_S
from topologies.networks.network import Network
from topologies.system.processes.programs import Program, python


def check_schedule(eve: EveSchedule, ends: Collection[str], network: NetworkDescription) -> None:
    """Raise BadInput if she cannot come so."""
    check_ranges(eve)
    if eve.eve is None:
        return
    eavesdropping.check(ends, network)
    if eve.until is not None and eve.until <= eve.at:
        raise BadInput(f"--until {eve.until:g} is not after --at {eve.at:g}")


class ScheduledEavesdropper:
    """Comes and leaves when it is time."""

    def __init__(self, options: EveSchedule, begin: str, end: str, folder: Path) -> None:
        """Let her come to the light from the one to the other; her policy is in the folder."""
        self._options, self._begin, self._end = options, begin, end
        self._folder = folder
        self._eve: Program | None = None
        self._is_there, self._gone = False, options.eve is None
        self._since_s = 0.0
        # Something else may keep her from coming in time; then she also leaves later.
        self._stays_s = math.inf if options.until is None else options.until - options.at

    def with_policy(self, network: NetworkDescription) -> NetworkDescription:
        """Return the network with a policy that can change; she is not in it yet."""
        if self._gone:
            return network
        return network.with_policy(write_policy(self._folder))

    @property
    def due_s(self) -> float:
        """When she comes or leaves next; infinite if she does neither."""
        if self._gone:
            return math.inf
        return self._since_s + self._stays_s if self._is_there else self._options.at

    def look(self, network: Network, series: TimeSeries) -> None:
        if self._gone:
            return
        if self._eve is None:
            self._eve = self._prepare(network)
        elif series.now_s < self.due_s:
            return
        elif not self._is_there:
            self._eve.wait_for("intercepting", START_TIMEOUT_S, network.check)
            tapping_policy(self._begin, self._end, eavesdropping.EVE, self._folder)
            ask("reload-policy")
            self._is_there, self._since_s = True, series.now_s
            series.add("eve_comes", fraction=self._options.eve)
        else:
            write_policy(self._folder)
            ask("reload-policy")
            self._eve.stop()
            self._gone = True
            series.add("eve_leaves", **vars(eavesdropping.summary_of(self._eve)))

    def _prepare(self, network: Network) -> Program:
        """Start her program, which takes no light before the policy puts her on the fibre."""
        name, socket = eavesdropping.EVE, network.runtime.socket(eavesdropping.EVE)
        command = [python(), "-m", "hosts.applications.intercept", "--stack", socket]
        return network.run_on(name, "eve-intercepts", [*command, str(self._options.eve)])
