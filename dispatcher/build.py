"""A physical layer made from a configuration, with its simulator, dump and record.

Keeps memory that has been freed, for the next block, instead of giving it back to the system.

A block of light takes and frees arrays of some megabytes a hundred times. The C library would
give each of them back, and the system clears every page that is taken again: that was more
than half of the time of an ideal block.
"""

import ctypes
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import TextIO

from dispatcher.clock import Clock
from dispatcher.devices.detectors import ClickObserver
from dispatcher.devices.hardware import Devices
from dispatcher.layer.compensation import Compensation
from dispatcher.layer.history import MOST_EVENTS, EventCapture, History
from dispatcher.layer.journal import Journal
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.memory import Memories
from dispatcher.layer.network import Network
from dispatcher.layer.news_delays import NewsDelays
from dispatcher.layer.ownership import MAX_BLOCKS, Ownership
from dispatcher.recording.recorder import RecordedClock, Recorder, open_private
from dispatcher.recording.traced import TracedSabot
from dispatcher.recording.writer import QasmWriter
from dispatcher.sabot.backends import BACKENDS
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.manager import Sabot
from dispatcher.sabot.simulation import Simulation
from dispatcher.timeouts import WRITING_DELAY_S
from wire.config import BadConfig, DispatcherConfig
from wire.dispatcher_service import RUNNER
from wire.parameters.physics import Device
from wire.registered import CLICK_OBSERVERS, SIMULATIONS, load, only

M_TRIM_THRESHOLD = -1  # of mallopt(3), from malloc.h
M_MMAP_THRESHOLD = -3
KEPT_BYTES = 256 << 20  # at the end of the heap
LARGEST_BYTES = 32 << 20  # of an array that is kept; the C library takes no more


def keep_freed_memory() -> bool:
    """Keep it from now on, in the whole process; return whether the C library can (musl cannot)."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    return bool(mallopt(M_MMAP_THRESHOLD, LARGEST_BYTES) and mallopt(M_TRIM_THRESHOLD, KEPT_BYTES))


BeginObserving = Callable[[DispatcherConfig, int], AbstractContextManager[ClickObserver]]
ConnectSabot = Callable[[str, str], AbstractContextManager[Simulation]]  # socket, backend
LEAST_SHARE = 1 << 22  # qubits
LEAST_BLOCKS = 8192
LEAST_EVENTS = 1_000_000


def build_layer(
    config: DispatcherConfig,
    clock: Clock,
    event_log: TextIO | None,
    sabot: Simulation | None = None,
    journal: Journal | None = None,
    capture: EventCapture | None = None,
    writing_delay_s: float = 0.0,
) -> PhysicalLayer:
    """Return the physical layer that the configuration describes.

    It simulates in this process if nothing else is given, and the process keeps freed memory from
    then on. Raise BadConfig or BadParameter for what cannot be.
    """
    keep_freed_memory()
    devices = dict(config.devices)
    for switch in config.switches:
        devices |= switch.inner_devices
    hardware = Devices(devices)
    devices |= {switch.name: switch.parts for switch in config.switches}
    _check(config, devices)
    sabot, draws = sabot or Sabot(BACKENDS[config.backend]), Draws(config.seed)
    news, compensation = NewsDelays(config.news_s), Compensation(devices, draws)
    return PhysicalLayer(
        clock=clock,
        sabot=sabot,
        draws=draws,
        network=Network(config.fibers, config.switches, compensation.loss),
        ownership=Ownership(clock.now_ns, news.longest_ns),
        history=_history(config, event_log, capture, writing_delay_s),
        devices=hardware,
        compensation=compensation,
        memories=Memories(hardware, clock, sabot, draws),
        max_live_qubits=config.max_live_qubits,
        share=equal_share(config, config.max_live_qubits, LEAST_SHARE),
        share_of_blocks=equal_share(config, MAX_BLOCKS, LEAST_BLOCKS),
        journal=journal or Journal(config.time),
        time=config.time,
        news=news,
    )


def _check(config: DispatcherConfig, devices: Mapping[str, Device]) -> None:
    if unknown := config.devices.keys() - config.tokens.keys():
        raise BadConfig(f"devices of {', '.join(sorted(unknown))}: there are no such hosts")
    compensates = any(device.compensator.retarders for device in devices.values())
    if compensates and not config.history_depth:
        raise BadConfig("compensators look at what fibres did: give history_depth 1 or more")


def _history(
    config: DispatcherConfig,
    event_log: TextIO | None,
    capture: EventCapture | None,
    writing_delay_s: float,
) -> History:
    share = equal_share(config, MOST_EVENTS, LEAST_EVENTS)
    depth, per_qubit = config.history_depth, config.per_qubit
    return History(depth, event_log, capture, per_qubit, share, writing_delay_s)


def equal_share(config: DispatcherConfig, whole: int, least: int) -> int:
    """Return how much of something one node may take: no node starves the others.

    Each host has an equal part, but in large networks the least that it needs; of qubits that is as
    much as eight sessions have under way.
    """
    hosts = config.tokens.keys() - {RUNNER, *(switch.name for switch in config.switches)}
    return min(whole, max(whole // max(1, len(hosts)), least))


def open_layer(
    config: DispatcherConfig, clock: Clock, event_log: TextIO | None, stack: ExitStack
) -> PhysicalLayer:
    """Return the layer with the server, the dump and the record that are configured.

    The stack closes all of them.
    """
    journal: Journal | None = None
    sabot: Simulation = Sabot(BACKENDS[config.backend])
    if config.sabot:
        connect: ConnectSabot = load(only("--sabot", SIMULATIONS))
        sabot = stack.enter_context(connect(config.sabot, config.backend))
    if config.qasm:
        dump = Path(config.qasm).open("w", buffering=1)  # noqa: SIM115
        sabot = TracedSabot(sabot, QasmWriter(stack.enter_context(dump)))
    if config.record:
        journal = Recorder(stack.enter_context(open_private(config.record)), config)
        clock = RecordedClock(clock, journal)
    capture = stack.enter_context(event_capture(config))
    layer = build_layer(
        config,
        clock,
        event_log,
        sabot=sabot,
        journal=journal,
        capture=capture,
        writing_delay_s=WRITING_DELAY_S,
    )
    stack.callback(layer.history.write_out)
    if config.tags:
        begin: BeginObserving = load(only("--tags", CLICK_OBSERVERS))
        layer.observer = stack.enter_context(begin(config, clock.now_ns()))
    return layer


@contextmanager
def event_capture(config: DispatcherConfig) -> Iterator[EventCapture | None]:
    if not config.event_capture:
        yield None
        return
    with Path(config.event_capture).open("wb") as file:
        yield EventCapture(file, config.fibers)
