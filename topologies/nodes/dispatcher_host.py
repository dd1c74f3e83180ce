"""The host that the dispatcher runs on."""

from topologies.links.causality import ways_of_news
from topologies.nodes.classical_host import ClassicalHost
from topologies.nodes.copper import COPPER
from topologies.nodes.tls import credentials
from topologies.system.runs.launching import launch
from topologies.system.runs.runtime import DISPATCHER, EVENT_CAPTURE, EVENT_LOG, RECORD
from wire.config import DISPATCHER_PORT, DispatcherConfig
from wire.credentials import Credentials
from wire.parameters.network import DispatcherSettings, part


class DispatcherHost(ClassicalHost):
    """`ed`: runs the dispatcher, which holds every qubit of the network.

    Its user sees the whole run, as `qmn spy` does there.
    """

    def __init__(
        self, name: str, confined: bool = False, memory_mib: int | None = None, **params: object
    ) -> None:
        super().__init__(name, confined, memory_mib, **params)
        self.network.dispatcher = f"{self.network.addresses[name]}:{DISPATCHER_PORT}"

    def config(self, **params: object) -> dict[str, object]:
        result = super().config(**params)
        config = self.dispatcher_config()
        self.program = launch(self.network, DISPATCHER, "dispatcher", config, self)
        return result

    def dispatcher_config(self) -> DispatcherConfig:
        """Return the dispatcher's configuration; all nodes and fibres are made by now."""
        network = self.network
        return DispatcherConfig(
            listen=network.dispatcher,
            socket=network.socket(DISPATCHER),
            seed=network.settings.seed,
            tokens=network.tokens,
            fibers=network.fibers,
            switches=list(network.switches.values()),
            event_log=str(network.private_file(EVENT_LOG)) if network.events else "",
            record=str(network.begun_anew(RECORD)) if network.record else "",
            qasm=str(network.private_file("quantum.qasm")) if network.qasm else "",
            devices=network.devices,
            event_capture=str(network.private_file(EVENT_CAPTURE)) if network.events else "",
            news_s=ways_of_news(network),
            credentials=self._credentials(),
            **part(DispatcherSettings, network.settings),
        )

    def _credentials(self) -> Credentials | None:
        if not self.network.tls:
            return None
        return credentials(self.network, self.name, {self.name: self.network.addresses[self.name]})

    def terminate(self) -> None:
        if self.program:
            self.program.stop()
        for program in self.network.programs:
            if program.name == COPPER:
                program.stop()
        super().terminate()
