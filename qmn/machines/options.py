"""Over how many machines a network goes, and which of its hosts are where."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import ClassVar

from qmn.options import BadInput
from topologies.system.machines.machine import Machine
from topologies.system.machines.tunnel import TUNNELS
from topologies.system.runs.runtime import Runtime
from wire.parameters.option import option
from wire.results.run_result import MachineFacts


@dataclass(frozen=True, kw_only=True)
class PlaceOptions:
    GROUP: ClassVar[str] = "several machines"
    place: tuple[str, ...] = option(
        (),
        "with --machines, put a host on a machine, as bob=m2 (repeatable; none: in turn)",
        metavar="HOST=MACHINE",
        recorded=False,
    )


@dataclass(frozen=True, kw_only=True)
class MachineOptions(PlaceOptions):
    GROUP: ClassVar[str] = PlaceOptions.GROUP
    machines: int = option(
        1,
        "number of machines: this one, m1, and workers on others (1)",
        metavar="N",
        range=(1, 64),
        recorded=False,
    )
    scheduler: str = option(
        "",
        "Dask scheduler of the workers (that of DASK_SCHEDULER_ADDRESS)",
        metavar="tcp://…",
        recorded=False,
    )
    tunnels: str = option(
        "",
        "between machines: VXLAN by the kernel, or by Open vSwitch in user space (the kernel's, "
        "where it has that)",
        choices=TUNNELS,
        recorded=False,
    )

    @property
    def against_steps(self) -> Iterator[str]:
        """Yield why the time of a network over these machines is paced."""
        if self.machines > 1:
            yield "other machines have clocks of their own (--machines)"


MACHINES = tuple(field.name for field in fields(MachineOptions))


@contextmanager
def machines_of(
    options: MachineOptions, hosts: Sequence[str], folder: Path | None, check: Callable[[], None]
) -> Iterator[dict[str, Machine]]:
    """Give the machine of each host that is not on this one; `check` may raise meanwhile.

    In the folder of the run, if it has one, is the key log of what goes between the machines.
    """
    if options.machines == 1:
        for name in ("place", "scheduler", "tunnels"):
            if getattr(options, name):
                raise BadInput(f"--{name} has no effect on one machine: add --machines 2")
        yield {}
        return
    # Dask takes a second to load: who has one machine does not wait for it.
    from qmn.machines.workers import on_machines

    with on_machines(
        options.machines, options.place, options.scheduler, hosts, folder, check
    ) as places:
        for machine in places.values():
            machine.tunnels = options.tunnels
        yield places


def machine_facts(runtime: Runtime) -> dict[str, MachineFacts]:
    return {
        machine.name: MachineFacts(
            machine.address,
            [host for host, each in runtime.places.items() if each is machine],
            asdict(machine.clock_offset()),
        )
        for machine in runtime.machines
    }
