"""The packet captures of a network: one tcpdump for each interface, started and ended together."""

import re
import signal
import time
from io import BytesIO
from pathlib import Path
from threading import Lock

from mininet.log import warn

from topologies.system.kernel.interfaces import INTERFACES
from topologies.system.machines.machine import Machine
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.programs import NetworkError, Program, stop_all
from topologies.system.runs.runtime import Runtime
from topologies.timeouts import POLL_S, READY_TIMEOUT_S, SETTLE_S
from wire.pcapng import with_clock

# In the kernel, for each capture: it has slots in powers of two of pages, for the largest packet
# and its head. In 16 MiB there are 255 for what TCP hands over, in 2 MiB 1,300 for an Ethernet's.
BUFFER_KIB, ETHERNET_BUFFER_KIB = 16_384, 2_048
# Linux lets TCP hand over up to 65,215 bytes at once (GSO_LEGACY_MAX_SIZE - MAX_TCP_HEADER - 1, in
# net/core/sock.c), after at most 94 of headers; a larger limit would need slots of twice the size.
MAX_PACKET_BYTES = 65_400
ETHERNET_PACKET_BYTES = 2_000
ETHERNET_HEAD_BYTES = 18  # with a tag of VLANs
# Headers, and set-up messages of quantum metadata, which have at most 512 bytes, whole.
HEADERS_BYTES = 640
DROPPED = re.compile(r"^(\d+) packets? dropped by kernel", re.MULTILINE)


class Captures:
    def __init__(self, network: Runtime) -> None:
        self._network = network
        self._files: dict[Program, Path] = {}  # of those that run
        self._elsewhere: dict[Program, tuple[Machine, Path, Path]] = {}  # files there and here
        self._starting: list[Program] = []
        self.packet_bytes = MAX_PACKET_BYTES  # that those which begin take at most
        self.packets_missed = 0  # by captures that have ended
        self.full: list[str] = []  # files that have ended before the network, as they were too long
        self._bounding = Lock()

    @property
    def programs(self) -> list[Program]:
        return list(self._files)

    def begin(self, name: str, interface: str, *expression: str, inside: int | None = None) -> Path:
        """Start to capture what passes an interface, of this machine or of a process's network.

        Return the file; packets are in there from `wait` on.
        """
        file = self._network.private_file(f"{name}.pcap")
        program = Program(f"tcpdump-{name}", self._network.folder / f"tcpdump-{name}.log")
        self._files[program] = file
        self._starting.append(program)
        most_bytes = self.packet_bytes if inside else min(self.packet_bytes, longest(interface))
        program.start([*capture_command(interface, file, most_bytes), *expression], inside)
        return file

    def begin_elsewhere(self, machine: Machine, interface: str, pid: int) -> Path:
        """Start to capture what passes an interface of a process's network on another machine.

        The file is here, by the clock of this machine, when captures have ended.
        """
        file = self._network.private_file(f"{interface}.pcap")
        there = self._network.folder / file.name
        program = Program(f"tcpdump-{interface}", self._network.folder / f"tcpdump-{interface}.log")
        self._files[program], self._elsewhere[program] = file, (machine, there, file)
        self._starting.append(program)
        # Nobody there looks how long it is: the kernel ends it.
        limit = ["prlimit", "--core=0", f"--fsize={self._network.settings.file_bytes}"]
        command = [*limit, *capture_command(interface, there, self.packet_bytes)]
        program.start_elsewhere(machine, command, pid, python=False)
        return file

    def bound(self) -> None:
        """End captures whose files have become too long, and say so; all others go on."""
        most_bytes = self._network.settings.file_bytes
        with self._bounding:
            for program, file in list(self._files.items()):
                there = program in self._elsewhere and program.status == -signal.SIGXFSZ
                if there or (file.exists() and file.stat().st_size >= most_bytes):
                    del self._files[program]  # nobody shall think that it has died
                    self.full.append(file.name)
                    gib = self._network.settings.file_gib
                    warn(f"{file.name} has {gib:g} GiB: no more is captured there (--file-gib)\n")
                    program.stop()
                    self._count_missed(program)

    def wait(self) -> None:
        for program in self._starting:
            program.wait_for("listening on", READY_TIMEOUT_S)
        self._starting.clear()

    def end(self) -> None:
        """End all when the packets that are still in the kernel have reached their files."""
        deadline, before = time.monotonic() + SETTLE_S, None
        while (sizes := self._sizes()) != before and time.monotonic() < deadline:
            before = sizes
            time.sleep(POLL_S)
        self.bound()
        with self._bounding:
            try:
                stop_all(self.programs)
            finally:
                for program in self._files:
                    self._count_missed(program)
                self._bring_back()
                self._files.clear()

    def _count_missed(self, program: Program) -> None:
        if program.log.exists():  # not where the folder of the run has been removed
            self.packets_missed += packets_missed(program.log.read_text(errors="replace"))

    def _bring_back(self) -> None:
        for machine, there, here in self._elsewhere.values():
            if machine.lost or (data := machine.get(there)) is None:
                continue
            ahead_ns = round(1e9 * machine.clock_offset().offset_s)
            with here.open("wb") as file:
                with_clock(BytesIO(data), file, ahead_ns)
        self._elsewhere.clear()

    def _sizes(self) -> list[int]:
        return [file.stat().st_size for file in self._files.values() if file.exists()]


def longest(interface: str) -> int:
    """Return how many bytes a packet of a switch's interface has at most.

    In the kernel TCP hands over many segments at once; Open vSwitch in user space drops such.
    """
    if openvswitch.datapath() == "kernel":
        return MAX_PACKET_BYTES
    try:
        return ETHERNET_HEAD_BYTES + int((INTERFACES / interface / "mtu").read_text())
    except FileNotFoundError as error:
        raise NetworkError(f"the interface {interface} was deleted at the start") from error


def capture_command(interface: str, file: Path, packet_bytes: int = MAX_PACKET_BYTES) -> list[str]:
    """Return the tcpdump command for one interface, nanosecond clock, packets up to a size.

    Each slot of the kernel's buffer is as large as the largest packet may be, so a larger limit
    would leave it few slots, and bursts would be missed. As a batch process it does not interrupt
    the programs whose packets it takes, and takes several at a time when processors are busy.
    """
    buffer_kib = ETHERNET_BUFFER_KIB if packet_bytes <= ETHERNET_PACKET_BYTES else BUFFER_KIB
    options = ["-n", "-U", "-s", str(packet_bytes), "-B", str(buffer_kib)]
    options += ["--immediate-mode", "--time-stamp-precision=nano"]
    # Another user's process would not learn that the runner has died.
    options += ["-Z", "root"]
    batch = ["chrt", "--batch", "0"]
    return [*batch, "tcpdump", *options, "-i", interface, "-w", str(file)]


def packets_missed(last_words: str) -> int:
    return sum(int(count) for count in DROPPED.findall(last_words))
