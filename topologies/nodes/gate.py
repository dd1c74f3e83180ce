"""The program that steps the network's time, beside the nodes."""

from contextlib import suppress
from select import select

from topologies.system.kernel.interfaces import repeat_nothing
from topologies.system.namespaces import with_own_network
from topologies.system.processes.programs import NetworkError
from topologies.system.runs.launching import launch
from topologies.system.runs.runtime import Runtime
from topologies.timeouts import LEAP_TIMEOUT_S, READY_TIMEOUT_S
from wire.config import GateConfig
from wire.leaps import LEAPS
from wire.network_time import NEVER, WITH_WALL, GateClient, SteppedTime

GATE = "gate"
ROUND_NS = 1_000_000_000_000  # longer than any network takes to start
SETTLED_NS = 90_000_000  # for what is repeated after the leap, before the controller looks again
OVER_NS = 1_000_000  # for packets that a leap brings about
NOT_OWN = "stepped time needs a network of its own: use `qmn run` or `qmn script`, or time='paced'"


class Start:
    """Lets time go with the wall until the network is ready, if it is stepped then."""

    def __init__(self, network: Runtime) -> None:
        """Start the gate, before all that waits.

        Raise NetworkError on the machine's own network, whose TCP and ARP it would change.
        """
        self._time = network.time
        self._client: GateClient | None = None
        if isinstance(network.time, SteppedTime):
            if not with_own_network():
                raise NetworkError(NOT_OWN)
            launch(
                network, GATE, "gate", GateConfig(str(network.logs / LEAPS), network.watched)
            ).wait_for("ready", READY_TIMEOUT_S)
            repeat_nothing()
            self._client = GateClient(network.time)
            self._client.wait_for(WITH_WALL)

    def end(self) -> None:
        """Step the time from now on, and return at the same instant of each run.

        Later instants count from there: seconds of the clock have the same last digits each time.
        """
        time = self._time
        if isinstance(time, SteppedTime):
            passed_ns = time.now_ns() - time.since_ns
            begin_ns = time.since_ns + (passed_ns // ROUND_NS + 1) * ROUND_NS
            for instant_ns in (begin_ns, begin_ns + SETTLED_NS):
                self._leap(instant_ns)
                time.settle()
            time.begin()
            # What programs do as it begins is over, and what they do at this leap, too.
            self._leap(begin_ns + 2 * SETTLED_NS)
            self._leap(begin_ns + 2 * SETTLED_NS + OVER_NS)
            assert self._client is not None
            self._client.wait_for(NEVER)

    def _leap(self, instant_ns: int) -> None:
        """Wait for an instant; raise NetworkError if it does not come in time."""
        if not self._reaches(instant_ns):
            raise NetworkError(f"{GATE}: programs have not paused for {LEAP_TIMEOUT_S:g} s")

    def settle(self) -> None:
        """Let what is under way arrive, and stop: a run ends at the same instant each time."""
        with suppress(EOFError, ConnectionError):  # the gate has ended, which its end reports
            if isinstance(self._time, SteppedTime):
                self._reaches(self._time.now_ns() + SETTLED_NS)

    def _reaches(self, instant_ns: int) -> bool:
        """Wait for an instant, and stay there; return whether the clock has reached it in time."""
        assert self._client is not None
        self._client.wait_for(instant_ns)
        if reached := bool(select([self._client], [], [], LEAP_TIMEOUT_S)[0]):
            self._client.take_notice()
        return reached

    def close(self) -> None:
        if self._client is not None:
            self._client.close()
