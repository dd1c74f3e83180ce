"""The optics of one quantum switch: what becomes of the light that comes to one of its ports.

    in_port: filter -> path that was open then (or, by crosstalk, each photon by itself, another
                       output in use; where there is none, a dark port, in which it is lost)
             -> loss of the path, more if hot -> attenuator and filter of the output

Everything that changes is kept over time, because light is resolved when it has passed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.photon_random import PhotonRandom, PhotonsByKey
from dispatcher.sabot.registers import Mask
from dispatcher.switch.timeline import Circuit, Interval, Steps, Timeline, Times
from wire.config import PathOptics, QuantumSwitch
from wire.optical import DEFAULT_FREQUENCY_MHZ

MAX_POWER_DBM = 0.0
BIAS_AT_THRESHOLD_MA = 10.0
BIAS_PER_MW_MA = 10.0
Met = tuple[slice, Interval]  # part of light, and the connection that it met


@dataclass(frozen=True)
class Light:
    """Light that comes to a port: in which pulses of a block, when, and its colour."""

    pulses: Mask
    photons: Mask  # of those, the ones whose own photon is not lost
    times_ns: Times
    frequency_mhz: int
    others: NDArray[np.int64]  # the pulses of photons beside the own ones, shape (m,)


class Leaving(NamedTuple):
    """Light that is about to leave by a port."""

    pulses: Mask  # shape (k,)
    others: Mask  # of the photons beside the own ones, shape (m,)


class Passed(NamedTuple):
    """Light that leaves by a port."""

    pulses: Mask  # whose own photon, if there is one, took this path
    photons: Mask  # of those, the ones whose own photon has come through
    transmission: float | NDArray[np.float64]  # of light in these pulses, shape () or (k,)
    others: Mask  # which photons beside the own ones took this path, shape (m,); all pass so far


class Through(NamedTuple):
    """The one path that light has taken, and how likely each photon came through."""

    interval: Interval
    transmission: float
    last_ns: int


class Channel(NamedTuple):
    """The grid of a multiplexer: the middle of its channel, and how far the next one is."""

    frequency_mhz: int
    grid_mhz: int


class Port:
    """A fibre port: a filter for each direction, its attenuator and what it has counted."""

    def __init__(self, frequency_mhz: int, channel: Channel | None = None) -> None:
        self.channel = channel  # behind a multiplexer, whose filters cannot be tuned
        self.rx_mhz = Steps(frequency_mhz)  # for light that comes from the fibre
        self.tx_mhz = Steps(frequency_mhz)  # for light that goes into it
        self.power_dbm = Steps(MAX_POWER_DBM)
        self.photons_in = self.photons_out = self.photons_lost = 0

    @property
    def bias_ma(self) -> float:
        """Bias current of the supervisory laser: threshold, and then linear in its power."""
        power_mw = 10 ** (self.power_dbm.now / 10)
        return BIAS_AT_THRESHOLD_MA + BIAS_PER_MW_MA * float(power_mw)


class OpticalSwitch:
    """An N x N cross-connect of linear optics; it never measures what passes."""

    def __init__(self, config: QuantumSwitch, ports: Mapping[int, Channel | None]) -> None:
        """Build the switch with these fibre ports, all dark; None: of a fibre, not of a channel."""
        self.config, self.name = config, config.name
        self.timeline = Timeline(round(config.switching_time_s * 1e9))
        frequency_mhz = nearest_channel(config, DEFAULT_FREQUENCY_MHZ)
        self.ports = {
            number: Port(channel.frequency_mhz if channel else frequency_mhz, channel)
            for number, channel in sorted(ports.items())
        }
        self.stuck: dict[int, int] = {}  # in_port to out_port
        self.failed = set[int]()  # inner ports
        self.cutoffs_s: dict[int, float] = {}  # of memories, if another was set
        self.memory: dict[str, float] = {}  # settings of all memories that were adjusted
        self.temperature_c = config.temperature_c
        self._hot = Steps(self._is_hot)
        self._paths = {(path.in_port, path.out_port): path for path in config.paths}

    @property
    def hot(self) -> bool:
        """Whether the switch is above its limit, so that every path loses more."""
        return bool(self._hot.now)

    @property
    def hot_loss_db(self) -> float:
        return self.config.hot_loss_db if self.hot else 0.0

    @property
    def paths(self) -> list[PathOptics]:
        more = self.hot_loss_db
        return [
            replace(path, insertion_loss_db=path.insertion_loss_db + more)
            for path in self._paths.values()
        ]

    def set_temperature(self, temperature_c: float, now_ns: int) -> None:
        """Have this temperature from now on; light that has passed already lost no more."""
        self.temperature_c = temperature_c
        self._hot.set(self._is_hot, now_ns)

    def rotation(self, in_port: int, out_port: int) -> int:
        path = self._paths.get((in_port, out_port))
        return self.config.rotation if path is None else path.rotation

    def cross(self, in_port: int, light: Light, random: PhotonRandom) -> dict[int, Passed]:
        """Return what leaves by which port, and count the own photons; all other light is lost."""
        times_ns, others = light.times_ns, light.others
        entered = self._filtered(light.pulses, in_port, light)
        met = list(self.timeline.passages(in_port, times_ns))
        leaving = {
            out_port: Leaving(pulses, pulses[others])
            for out_port, pulses in _route(met, entered).items()
        }
        if self.config.crosstalk_db is not None:
            leaving = self._stray(leaving, light, random)
        passed = {}
        for out_port, (pulses, rest) in leaving.items():
            leaves = self._filtered(np.ones_like(pulses), out_port, light, leaving=True)
            pulses, rest = pulses & leaves, rest & leaves[others]
            loss_db = self._loss_db(in_port, out_port, times_ns)
            transmission = 10 ** (-loss_db / 10)
            photons = pulses & light.photons
            if loss_db.any() if isinstance(loss_db, np.ndarray) else loss_db:
                photons &= random.happens("pass", transmission)
            passed[out_port] = Passed(pulses, photons, transmission, rest)
        self._count(in_port, light, passed, met)
        return passed

    def through(self, in_port: int, times_ns: Times, frequency_mhz: int) -> Through | None:
        """Return the path that all light takes at these times; None if it comes apart."""
        met = list(self.timeline.passages(in_port, times_ns))
        if self.config.crosstalk_db is not None or len(met) != 1:
            return None
        ((part, interval),) = met
        port, out = self.ports[in_port], self.ports[interval.out_port]
        first_ns, last_ns = times_ns[0], times_ns[-1]
        changing = port.rx_mhz, out.tx_mhz, out.power_dbm, self._hot
        if part.stop - part.start < len(times_ns) or any(
            each.lowest(first_ns, last_ns) < each.highest(first_ns, last_ns) for each in changing
        ):
            return None
        moment = np.array([first_ns])
        through = self.transmission(in_port, interval.out_port, moment, frequency_mhz)
        return Through(interval, float(through[0]), last_ns)

    def count_passed(self, in_port: int, through: Through, came: int, left: int) -> None:
        """Count light that has taken a path all the while."""
        self.lose(in_port, came - left)
        self.ports[in_port].photons_in += left
        self.ports[through.interval.out_port].photons_out += left
        through.interval.circuit.count_light(left, through.last_ns)

    def transmission(
        self, in_port: int, out_port: int, times_ns: Times, frequency_mhz: int
    ) -> NDArray[np.float64]:
        """Return how likely a photon of this colour passes a path that is open, shape (k,)."""
        everything = np.ones(len(times_ns), dtype=bool)
        light = Light(everything, everything, times_ns, frequency_mhz, np.zeros(0, np.int64))
        passes = self._filtered(everything, in_port, light)
        passes = self._filtered(passes, out_port, light, leaving=True)
        loss_db = np.asarray(self._loss_db(in_port, out_port, times_ns))
        return passes * 10 ** (-loss_db / 10) * (1 - self.crosstalk)

    def count_through(self, in_port: int, out_port: int, came: int, left: int) -> None:
        self.ports[in_port].photons_in += came
        self.ports[in_port].photons_lost += came - left
        self.ports[out_port].photons_out += left
        circuit = self.timeline.circuit_of(in_port)
        if circuit is not None:
            circuit.photons += left

    def lose(self, in_port: int, photons: int) -> None:
        self.ports[in_port].photons_in += photons
        self.ports[in_port].photons_lost += photons

    def circuits(self, now_ns: int) -> list[Circuit]:
        """Return the circuits that are open or were not long ago."""
        return self.timeline.circuits(now_ns)

    @property
    def crosstalk(self) -> float:
        crosstalk_db = self.config.crosstalk_db
        return 0.0 if crosstalk_db is None else float(10 ** (-crosstalk_db / 10))

    @property
    def _is_hot(self) -> bool:
        return self.temperature_c > self.config.max_temperature_c

    def _filtered(self, pulses: Mask, number: int, light: Light, leaving: bool = False) -> Mask:
        port = self.ports[number]
        filter_mhz = port.tx_mhz if leaving else port.rx_mhz
        grid_mhz = port.channel.grid_mhz if port.channel else self.config.grid_mhz
        middle_mhz = filter_mhz.at(light.times_ns)
        if isinstance(middle_mhz, np.ndarray):
            return pulses & (np.abs(middle_mhz - light.frequency_mhz) < grid_mhz / 2)
        passes = abs(middle_mhz - light.frequency_mhz) < grid_mhz / 2  # all or none, as mostly
        return pulses if passes else np.zeros_like(pulses)

    def _stray(
        self, leaving: Mapping[int, Leaving], light: Light, random: PhotonRandom
    ) -> dict[int, Leaving]:
        """Let photons leave by another output that was in use just then, any alike, or be lost.

        Each strays by itself. Light that strays where no other output is in use leaves by a dark
        port, behind which nobody is.
        """
        size, several = light.pulses.size, random.at("others").beside(light.others.size)
        own, others = (each.events("crosstalk", self.crosstalk) for each in (random, several))
        strays = np.concatenate([own, others + size])
        pulses = np.concatenate([own, light.others[others]])
        where = PhotonsByKey.of(random, strays).uniform("wrong output")
        in_use = self.timeline.outputs_in_use(light.times_ns)
        outputs = sorted(in_use)
        open_then = np.array([in_use[port][pulses] for port in outputs]).reshape(len(outputs), -1)
        result: dict[int, Mask] = {}
        for out_port, groups in leaving.items():
            photons = np.concatenate(groups)
            here = photons[strays]
            photons[strays] = False
            _add(result, out_port, photons)
            wrong = open_then.copy()
            wrong[outputs.index(out_port)] = False
            elsewhere = here & wrong.any(axis=0)
            away, chosen = strays[elsewhere], _choose(wrong[:, elsewhere], where[elsewhere])
            for row in np.unique(chosen):
                mask = np.zeros(photons.size, dtype=bool)
                mask[away[chosen == row]] = True
                _add(result, outputs[row], mask)
        return {port: Leaving(mask[:size], mask[size:]) for port, mask in result.items()}

    def _loss_db(self, in_port: int, out_port: int, times_ns: Times) -> float | NDArray[np.float64]:
        path = self._paths.get((in_port, out_port), self.config)
        attenuation_db = -self.ports[out_port].power_dbm.at(times_ns)
        hot = self._hot.at(times_ns)
        return path.insertion_loss_db + self.config.hot_loss_db * hot + attenuation_db

    def _count(
        self, in_port: int, light: Light, passed: dict[int, Passed], met: Sequence[Met]
    ) -> None:
        came = int(np.count_nonzero(light.photons))
        left = 0
        for out_port, leaving in passed.items():
            photons = int(np.count_nonzero(leaving.photons))
            self.ports[out_port].photons_out += photons
            left += photons
        self.ports[in_port].photons_in += came
        self.ports[in_port].photons_lost += came - left
        # In an interval a photon of this input by this output has not strayed.
        for part, interval in met:
            counted = passed[interval.out_port].photons[part]
            interval.circuit.count(counted, light.times_ns, part.start)


def _add(result: dict[int, Mask], out_port: int, photons: Mask) -> None:
    result[out_port] = result.get(out_port, False) | photons


def _route(met: Sequence[Met], photons: Mask) -> dict[int, Mask]:
    leaving: dict[int, Mask] = {}
    for part, interval in met:
        mask = leaving.setdefault(interval.out_port, np.zeros(len(photons), dtype=bool))
        mask[part] = photons[part]
    return leaving


def nearest_channel(config: QuantumSwitch, frequency_mhz: int) -> int:
    highest = (config.max_frequency_mhz - config.min_frequency_mhz) // config.grid_mhz
    step = round((frequency_mhz - config.min_frequency_mhz) / config.grid_mhz)
    return config.min_frequency_mhz + min(max(step, 0), highest) * config.grid_mhz


def _choose(possible: NDArray[np.bool_], draws: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return for each column one of its true rows, uniformly by a draw from [0, 1)."""
    rank = (draws * possible.sum(axis=0)).astype(np.int64)
    chosen: NDArray[np.int64] = (possible.cumsum(axis=0) > rank).argmax(axis=0)
    return chosen
