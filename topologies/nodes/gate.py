"""The program that steps the network's time, beside the nodes."""

from topologies.system.kernel.interfaces import repeat_nothing
from topologies.system.runs.launching import launch
from topologies.system.runs.runtime import Runtime
from topologies.timeouts import READY_TIMEOUT_S
from wire.config import GateConfig
from wire.network_time import NEVER, WITH_WALL, GateClient, SteppedTime

GATE = "gate"


class Start:
    """Lets time go with the wall until the network is ready, if it is stepped then."""

    def __init__(self, network: Runtime) -> None:
        """Start the gate, before all that waits."""
        self._client: GateClient | None = None
        if isinstance(network.time, SteppedTime):
            launch(network, GATE, "gate", GateConfig()).wait_for("ready", READY_TIMEOUT_S)
            repeat_nothing()
            self._client = GateClient(network.time)
            self._client.wait_for(WITH_WALL)

    def end(self) -> None:
        """Step the time from now on."""
        if self._client is not None:
            self._client.wait_for(NEVER)

    def close(self) -> None:
        """Disconnect from the gate."""
        if self._client is not None:
            self._client.close()
