"""The controller with its framework loaded, but not begun: it is forked off as it is.

So it is in the networks of `qmn` that is forked off a process with this module, too.
"""

from collections.abc import Sequence
from importlib import import_module

from controller_apps.__main__ import APPS
from controller_apps.__main__ import main as begin
from controller_apps.openflow import framework
from topologies.system.processes.forks import MODULES, Forked, ForkServer, request
from topologies.system.processes.programs import Program, python
from topologies.system.runs import runtime

CONTROLLER = "controller_apps"
PARTS = (*(f"apps.{name}" for name in APPS), "console.console", "console.facts", "console.guard")


def main() -> int:
    """Run it; to load Ryu makes an eventlet hub, whose files no fork has: it gets a new one.

    Eventlet would look through all that is loaded for locks that a green thread could wait for;
    here that is much more than the controller's own, which makes its locks later.
    """
    if framework.NAME == "ryu":
        eventlet = framework.hub.eventlet
        vars(eventlet.patcher).update(_green_existing_locks=lambda _kind: None)
        eventlet.hubs.use_hub()
    return begin()


class ForkServerWithController(ForkServer):
    """The fork server of a network whose runner has loaded the controller, too."""

    def __init__(self, program: Program) -> None:
        super().__init__(program, (*MODULES, __name__))

    def serves(self, command: Sequence[str]) -> bool:
        """Whether a command starts what is loaded: of controllers, that on this framework."""
        return super().serves(command) or self._starts_controller(command)

    def start(
        self,
        name: str,
        command: Sequence[str],
        log: int,
        namespace_pid: int | None,
        descriptors: Sequence[int],
    ) -> Forked:
        """Start a command that it serves, as Program.start says."""
        asked = request(name, command, namespace_pid, descriptors)
        if self._starts_controller(command):
            asked["module"] = __name__
        return self.fork(asked, [log, *descriptors])

    @staticmethod
    def _starts_controller(command: Sequence[str]) -> bool:
        return [*command[:3]] == [python(), "-m", CONTROLLER] and framework.NAME in command


for part in PARTS:
    import_module(f"{CONTROLLER}.{part}")
vars(runtime).update(ForkServer=ForkServerWithController)
