"""One emulated network from start to end: check, start, watch, always clean up."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import Self

from mininet.net import Mininet
from mininet.node import Host
from mininet.topo import Topo

from topologies.links.copper_lengths import assign_copper_lengths
from topologies.links.fiber import FiberLink
from topologies.links.management import bridge_of
from topologies.networks.captures import MAX_PACKET_BYTES, Captures
from topologies.networks.discovery import Discovery
from topologies.networks.disk import DiskKeeper
from topologies.networks.long_start import LongStart
from topologies.networks.parallel import ParallelMininet
from topologies.networks.placing import place
from topologies.networks.requirements import (
    allow_files,
    delete_interfaces_of,
    refuse_taken_names,
    require_certificates,
    require_root,
)
from topologies.networks.switch_watch import SwitchWatch
from topologies.nodes import QuantumController
from topologies.nodes.controller import is_copper_switch
from topologies.nodes.copper import COPPER
from topologies.nodes.gate import GATE, Start
from topologies.system.kernel import interfaces
from topologies.system.machines import user_space
from topologies.system.machines.errand import Errand
from topologies.system.machines.node import NodeElsewhere
from topologies.system.machines.packing import unpacked
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.outputs import LostOutput
from topologies.system.processes.programs import NetworkError, Program, stop_all
from topologies.system.processes.shells import ShellWatcher
from topologies.system.processes.signals import CLEANED, NotCleanedUp, budget
from topologies.system.processes.signals import Interrupted as Interrupted
from topologies.system.processes.signals import Signals as Signals
from topologies.system.runs import runtime
from topologies.system.runs.runtime import DISPATCHER, Runtime
from topologies.timeouts import (
    CLEAN_UP_TIMEOUT_S,
    DAEMON_END_TIMEOUT_S,
    END_TIMEOUT_S,
    INTERFACE_S,
    POLL_S,
    PROGRAM_S,
    READY_TIMEOUT_S,
    STOPPED_LOOK_S,
    STOPPED_TIMEOUT_S,
)
from wire.config import BadConfig
from wire.packed_folder import Entry
from wire.parameters.checks import remedy
from wire.parameters.physics import BadParameter


class Network:
    """A running network; a context manager that leaves nothing behind.

    Raise NetworkError if it cannot start, Interrupted if a signal came meanwhile.
    """

    def __init__(
        self,
        topo: Callable[[], Topo],
        settings: Runtime,
        signals: Signals,
        tell: Callable[[Exception], None] | None = None,
        say: Callable[[str], None] | None = None,
        packet_bytes: int = 0,
    ) -> None:
        """Set it up; call `tell` with the cause of its end before the clean-up.

        `say` gets what a long start waits for. At most `packet_bytes` of each packet on copper, and
        of OpenFlow, are captured, from the beginning of each connection on; 0: none.
        """
        self._packet_bytes = packet_bytes
        self.captured: list[Path] = []  # files
        self._long_start = LongStart(say)
        self._topo = topo
        self._tell = tell
        self.runtime = settings
        self._signals = signals
        self.captures = Captures(settings)
        self._openflow: Path | None = None  # its capture, from its beginning on
        self._cleanup = ExitStack()
        self._start_of_time: Start | None = None
        self._stopped: dict[str, float] = {}  # what a signal has stopped, since when
        self._switches = SwitchWatch()
        self._look_again_at = 0.0
        self._applications: list[Program] = []
        self._errands: dict[Program, Errand] = {}  # of those on other machines
        self._struck: Program | None = None  # of these, as the last look has found

    def __enter__(self) -> Self:
        self._cleanup.callback(self.runtime.remove)
        try:
            self._start()
        except BaseException as error:
            self._clean_up(error)
            raise
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        try:
            if error is None and self._start_of_time is not None:
                self._start_of_time.settle()
        finally:
            self._clean_up(error)

    def _clean_up(self, cause: BaseException | None) -> None:
        """Remove everything, whatever reporting does; no further fault hides the cause."""
        try:
            self.runtime.time_limited = True
            limit_s = CLEAN_UP_TIMEOUT_S + INTERFACE_S * len(interfaces.all_here())
            with self._signals.deferred(), budget(limit_s, "clean-up"), self._cleanup:
                self._report(cause)
        except (NetworkError, OSError) as error:
            uncleaned = NotCleanedUp(error)
            if cause is None:
                raise uncleaned from error
            cause.add_note(str(uncleaned))
        else:
            if isinstance(cause, KeyboardInterrupt) or (cause and self._signals.came_before()):
                cause.add_note(CLEANED)

    def _report(self, cause: BaseException | None) -> None:
        """Report what ends the network; the terminal may be what is lost."""
        if self._tell is not None and isinstance(cause, Exception):
            with suppress(LostOutput, OSError):
                self._tell(cause)

    def _start(self) -> None:
        require_root()
        allow_files()
        self._cleanup.callback(self._stop_programs)
        self.runtime.forks()  # what it loads takes longest
        self._cleanup.callback(openvswitch.end)
        openvswitch.start(self.runtime.daemon)
        self._start_of_time = Start(self.runtime)
        self._cleanup.callback(self._start_of_time.close)
        self._disk = self._cleanup.enter_context(
            DiskKeeper(
                (self.runtime.logs, self.runtime.folder), self._programs, self.captures.bound
            )
        )
        self._signals.check()
        runtime.begin(self.runtime)
        topo = self._topo()
        settings = self.runtime.settings
        assign_copper_lengths(topo, settings.copper_km, settings.copper_mbps)
        place(topo, self.runtime.places)
        refuse_taken_names(topo)
        require_certificates(topo, self.runtime)
        # Mininet would raise kernel limits for the whole machine, which is not ours to change.
        Mininet.inited = True
        self.net = ParallelMininet(topo=topo, controller=QuantumController, build=False)
        self._cleanup.callback(delete_interfaces_of, topo.switches())
        if self.runtime.places:
            self._cleanup.callback(user_space.remove)
        self._cleanup.callback(self.runtime.from_elsewhere.close)
        self._cleanup.callback(self.net.stop)
        self._cleanup.callback(openvswitch.end)
        self._cleanup.callback(self._stop_programs)
        self._cleanup.callback(self.captures.end)
        self.runtime.time_limited = True
        self._build_and_start()
        self._wait_until_ready()
        self._switches = SwitchWatch(self.net.switches)
        self.runtime.time_limited = False
        self._start_of_time.end()

    def _build_and_start(self) -> None:
        """Let Mininet start all nodes; where it fails because of another's end, name that."""
        try:
            self._long_start.waits_for("programs to load")
            self.net.build()
            self._signals.check()
            self._long_start.waits_for(f"{len(self.net.switches)} switches to start")
            self._capture_beginnings()
            self.net.start()
        except SystemExit as error:
            self.check()
            raise NetworkError("Mininet has given up; it says above why") from error
        except NetworkError as error:
            for node in self._watched():
                if node.shell_ended and node.name not in str(error).split():
                    raise NetworkError(f"{node.name} died at its start: {error}") from error
            if not all(program.running for program in self.runtime.programs):
                self._require_others_for(DAEMON_END_TIMEOUT_S)
            raise
        except Interrupted:
            raise
        except (BadParameter, BadConfig) as error:  # of a node or link that cannot be
            raise NetworkError(str(error)) from error
        except Exception:  # Mininet raises no other kind
            self.check()
            raise

    def _capture_beginnings(self) -> None:
        """Capture before connections begin: Wireshark needs the first bytes of gRPC and TLS."""
        if self._packet_bytes:
            self.captured = self.capture(
                *self.copper_switches, openflow=True, packet_bytes=self._packet_bytes
            )
        elif self.runtime.settings.tls and self.runtime.log_folder is not None:
            self.capture_openflow()

    def _watched(self) -> Iterator[ShellWatcher]:
        """Yield our nodes; a topology may have others, too."""
        for node in (*self.net.hosts, *self.net.switches, *self.net.controllers):
            if isinstance(node, ShellWatcher):
                yield node

    def _programs(self) -> list[Program]:
        """Return all that runs beside hosts' applications and captures; daemons come first."""
        return [*openvswitch.programs(), *self.runtime.programs]

    def _stop_programs(self) -> None:
        """End the dispatcher and the copper to it, and then the gate, last.

        To all others their end is a fault.
        """
        programs = self.runtime.programs
        for last in ((DISPATCHER, COPPER, GATE), (GATE,), ()):
            stop_all([program for program in programs if program.name not in last])

    def _wait_until_ready(self) -> None:
        programs = list(self.runtime.programs)
        limit_s = READY_TIMEOUT_S + PROGRAM_S * len(programs)
        for program in programs:
            program.wait_for(
                "ready", limit_s, partial(self._check_start, f"{program.name} to start")
            )
            self._signals.check()
        finding = "the controller to find switches and fibres"
        Discovery(self.net, self.runtime).wait(partial(self._check_start, finding))
        if bridge := next(iter(self.runtime.bridges), None):
            openvswitch.apply_settings(bridge)

    def _check_start(self, what: str) -> None:
        self._long_start.waits_for(what)
        self.check()

    def host(self, name: str) -> Host:
        """Return a host; raise NetworkError if there is none of that name."""
        hosts = {host.name: host for host in self.net.hosts}
        if name not in hosts:
            raise NetworkError(f"unknown host {name!r}: {remedy(name, sorted(hosts))}")
        return hosts[name]

    def run_on(self, host: str, name: str, command: list[str]) -> Program:
        """Start an application on a host; it ends with the network at the latest.

        To another machine the files that its words name go along, and come back.
        """
        node = self.host(host)
        if host not in self.runtime.places:
            return self.run_beside(name, command, node.pid)
        program = self._application(name)
        errand = Errand(self.runtime.places[host], self.runtime.folder / name, command)
        self._errands[program] = errand
        self._cleanup.callback(errand.bring_back)
        self._cleanup.callback(program.stop)
        errand.start(program, node.pid_there)
        return program

    def run_as_people_do(self, host: str, name: str, command: list[str]) -> Program:
        """Start a program that people have written on a host: it sees what they see there.

        On another machine it is as `run_on`.
        """
        if host in self.runtime.places:
            return self.run_on(host, name, command)
        program = self._application(name)
        self._cleanup.callback(program.stop)
        self.host(host).start_program(program, command)
        return program

    def share_folder(self, host: str, packed: bytes, name: str) -> Path:
        """Copy a packed folder to a host on another machine; return its path there."""
        folder = self.runtime.folder / name
        self.runtime.places[host].put_folder(packed, folder)
        return folder

    def bring_folder(self, host: str, folder: Path) -> list[Entry]:
        """Return what is in a folder of a host on another machine; nothing if that is lost."""
        machine = self.runtime.places[host]
        return [] if machine.lost else unpacked(machine.get_folder(folder))

    def bring_back(self, program: Program) -> None:
        """Write here what an application has written so far, if it is on another machine."""
        if program in self._errands:
            self._errands[program].bring_back()

    def _application(self, name: str) -> Program:
        """Return a program that may end before the network, and is watched until it does."""
        program = Program(name, self.runtime.private_file(f"{name}.log"))
        self._applications.append(program)
        return program

    def run_beside(
        self, name: str, command: list[str], namespace_pid: int | None = None
    ) -> Program:
        """Start a program on this machine itself; it ends with the network at the latest."""
        program = self._application(name)
        self._cleanup.callback(program.stop)
        program.start(command, namespace_pid, forks=self.runtime.forks())
        return program

    @property
    def copper_switches(self) -> list[str]:
        """The switches of copper alone, in the order of the topology."""
        return [switch.name for switch in self.net.switches if is_copper_switch(switch)]

    def capture(
        self, *switches: str, openflow: bool = False, packet_bytes: int = MAX_PACKET_BYTES
    ) -> list[Path]:
        """Capture every link of these switches from now on; return the files.

        A link to another machine is captured at its end there, too. With `openflow` the last file
        has the messages of controller and switches. At most `packet_bytes` of each packet are
        captured.
        """
        hidden = {"lo", *self.runtime.management}
        watched = [
            name
            for switch in switches
            for name in self.net.get(switch).intfNames()
            if name not in hidden
        ]
        self.captures.packet_bytes = packet_bytes
        files = [self.captures.begin(name, interface=name) for name in watched]
        files += [
            self.captures.begin_elsewhere(node.machine, interface, node.pid_there)
            for switch in switches
            for node, interface in self._copper_elsewhere(switch)
        ]
        files += [self._begin_openflow()] if openflow else []
        self.captures.wait()
        return files

    def _copper_elsewhere(self, switch: str) -> Iterator[tuple[NodeElsewhere, str]]:
        """Yield hosts of other machines that have copper to a switch, each with its interface."""
        for link in self.net.links:
            for near, far in ((link.intf1, link.intf2), (link.intf2, link.intf1)):
                is_there = near.node.name == switch and isinstance(far.node, NodeElsewhere)
                if is_there and not isinstance(link, FiberLink):
                    yield far.node, str(far)

    def capture_openflow(self) -> Path:
        """Capture from now on what the controller and the switches say; return the file."""
        file = self._begin_openflow()
        self.captures.wait()
        return file

    def _begin_openflow(self) -> Path:
        if self._openflow is None:
            (c0,) = (each for each in self.net.controllers if isinstance(each, QuantumController))
            bridge, port = bridge_of(c0.name), str(self.runtime.settings.openflow_port)
            self._openflow = self.captures.begin(
                c0.name, bridge, "tcp", "port", port, inside=c0.pid
            )
        return self._openflow

    def check(self) -> None:
        """Raise if a signal has come or a program of the network has ended."""
        self._signals.check()
        for machine in self.runtime.machines:
            machine.check()
        self._disk.check()
        self.captures.bound()
        programs = (*self._programs(), *self.captures.programs)
        if not all(program.running for program in programs):
            self._require_others_for(DAEMON_END_TIMEOUT_S)
            self._switches.require_interfaces(0.0)
            # Programs that end with the dispatcher were started later, and may have ended before.
            first = next(program for program in programs if not program.running)
            raise NetworkError(f"{first.name} died in mid-run: {first.end()}")
        for node in self._watched():
            if node.shell_ended:
                raise NetworkError(node.no_shell)
        # Seen twice: what ends because its host's shell does may have ended before that.
        before = self._struck
        self._struck = next((each for each in self._applications if each.struck_down), None)
        if self._struck is not None and self._struck is before:
            if self.runtime.machines:
                self._require_others_for(DAEMON_END_TIMEOUT_S)
            raise NetworkError(f"{before.name} died in mid-run: {before.end()}")
        if time.monotonic() > self._look_again_at:
            self._look_again_at = time.monotonic() + STOPPED_LOOK_S
            self._require_none_stopped(STOPPED_TIMEOUT_S)
            self._switches.require_interfaces(DAEMON_END_TIMEOUT_S)

    def _require_others_for(self, duration_s: float) -> None:
        """Raise if a disk is full, a daemon ends or another machine is lost within so long.

        A daemon's sockets close before it has ended, and programs end because of that. Programs on
        a machine may end before its agent.
        """
        self._disk.look_at_disks()
        self._disk.check()
        deadline = time.monotonic() + duration_s
        while time.monotonic() < deadline:
            for machine in self.runtime.machines:
                machine.check()
            openvswitch.require_alive()
            time.sleep(POLL_S)

    def explain(self) -> None:
        """Raise the root cause of a failure if it lies in the network.

        A program's sockets close a moment before it ends. To all others, a
        program that a signal has stopped is a peer that does not answer.
        """
        deadline = time.monotonic() + END_TIMEOUT_S
        while time.monotonic() < deadline:
            self.check()
            time.sleep(POLL_S)
        self._disk.look_at_disks()
        self._disk.check()
        self._require_none_stopped(0.0)
        self._switches.require_interfaces(0.0)
        for program in self._applications:
            if error := program.crash():
                raise NetworkError(f"{program.name} ended: {error}")
        self._switches.require_flows()

    def _require_none_stopped(self, patience_s: float) -> None:
        """Raise for what has been seen to be stopped by a signal for so long."""
        now = time.monotonic()
        stopped = set()
        of_the_network = *self._programs(), *self.captures.programs
        for program in (*of_the_network, *self._applications):
            stopped |= {program.name} if program.stopped else set()
        stopped |= {node.name for node in self._watched() if node.shell_stopped}
        self._stopped = {name: self._stopped.get(name, now) for name in stopped}
        for name, since in self._stopped.items():
            if now - since >= patience_s:
                raise NetworkError(
                    f"{name} does not answer: a signal has stopped it (SIGSTOP); `kill -CONT` "
                    f"within {STOPPED_TIMEOUT_S:g} s lets such a process go on"
                )
