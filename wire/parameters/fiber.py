"""The parameters of a fibre, each with unit, range and default, declared here alone.

The default is an ideal fibre of 10 m. `optics` fills in what a kind of fibre brings along.
"""

from dataclasses import asdict, dataclass, field, fields
from typing import Any, Self

from wire.optical import CHANNEL_MHZ, DEFAULT_FREQUENCY_MHZ
from wire.parameters.checks import check_names
from wire.parameters.physics import OURS, SUM_TOLERANCE, BadParameter, check, choice, parameter
from wire.registered import NOISE, registered

SPEED_IN_FIBER_M_PER_S = 2.04e8  # group index 1.468
COMPENSATED = "compensated"  # birefringence
MOST_CHANNELS = 64
HIGHEST_CHANNEL_MHZ = 196_100_000  # of the C band
MHZ_PER_GHZ = 1_000
GRID = "ITU-T G.694.1"
THERMAL = "40 ps/(km K): Slavik et al., Scientific Reports 5, 15447 (2015)"
RAMAN = "Eraerds et al., New Journal of Physics 12, 063027 (2010)"

# Values of kinds of fibre at 1550 nm. The standard fibre loses least and turns the
# polarisation as it likes; the polarisation-maintaining (PM) one keeps it, and loses more.
# smf: catalogues of ITU-T G.652.D fibre have .2 dB/km. Nothing holds the polarisation: the angle
#   has walked half a turn after 1 km; it changes within minutes. 17 ps/(nm km) at 1550 nm.
# pm: PANDA fibre, .5 dB/km at most (Fujikura's SM15-PS). A crosstalk of -25 dB in 100 m is
#   .0316 = sin^2(angle / 2) after 1 km.
KINDS: dict[str, dict[str, float]] = {
    "ideal": {},
    "smf": {
        "loss_db_per_km": 0.2,
        "polarization_drift_rad_per_sqrt_km": 3.14,
        "dispersion_ps_per_nm_km": 17.0,
    },
    "pm": {
        "loss_db_per_km": 0.5,
        "polarization_drift_rad_per_sqrt_km": 0.36,
        "dispersion_ps_per_nm_km": 17.0,
    },
    "custom": {},
}


@dataclass(frozen=True)
class FiberEnd:
    """A port that a fibre ends in: a host's interface, or a port number of a switch."""

    node: str
    port: str  # of a host: its interface name; of a quantum switch: its OpenFlow port number


@dataclass(frozen=True, kw_only=True)
class FiberOptics:
    """The parameters of a fibre, alike in both directions; the formulas are in dispatcher/."""

    kind: str = choice(*KINDS)
    length_km: float = parameter(0.01, 0.0, 20_000.0, source=OURS)  # at most 98 ms
    loss_db_per_km: float = parameter(0.0, 0.0, 1_000.0)
    connectors_db: float = parameter(0.0, 0.0, 100.0)  # of all connectors and splices together
    depolarizing: float = parameter(0.0, 0.0, 1.0)  # probability p: X, Y and Z each with p/4
    dephasing: float = parameter(0.0, 0.0, 1.0)  # probability of Z
    pauli_x: float = parameter(0.0, 0.0, 1.0)  # a Pauli channel: probabilities of X, Y and Z,
    pauli_y: float = parameter(0.0, 0.0, 1.0)  # one of which happens at most
    pauli_z: float = parameter(0.0, 0.0, 1.0)
    # Birefringence turns the polarisation about any axis: rms angle, growing as the root of the
    # length, and how long it lasts. Qubits of other encodings do not see it.
    polarization_drift_rad_per_sqrt_km: float = parameter(0.0, 0.0, 100.0)
    polarization_drift_time_s: float = parameter(100.0, 1e-9, 1e9, source=OURS)
    # Passively, as by a Faraday mirror: light that is compensated keeps its polarisation.
    birefringence: str = choice("drifts", COMPENSATED, source=OURS)
    # Of two polarisations one is lost more, by so much, or comes later, by so much on average; the
    # axis is any, and which is later changes within the same time.
    pdl_db: float = parameter(0.0, 0.0, 100.0)
    pmd_ps_per_sqrt_km: float = parameter(0.0, 0.0, 1_000.0)
    # The same of the phase between time bins, a turn about Z.
    phase_drift_rad_per_sqrt_km: float = parameter(0.0, 0.0, 100.0)
    phase_drift_time_s: float = parameter(100.0, 1e-9, 1e9, source=OURS)
    # Chromatic dispersion: how much later light of a longer wavelength comes.
    dispersion_ps_per_nm_km: float = parameter(0.0, -1_000.0, 1_000.0)
    # Bursts: depolarising while the fibre is in its bad state, and how often it changes.
    burst_depolarizing: float = parameter(0.0, 0.0, 1.0)
    burst_start_hz: float = parameter(1.0, 0.0, 1e12, source=OURS)  # from good to bad
    burst_end_hz: float = parameter(1_000.0, 0.0, 1e12, source=OURS)  # from bad to good
    # Temperature since the last calibration: a slope and a random walk; what it does to the delay.
    temperature_slope_k_per_s: float = parameter(0.0, -10.0, 10.0)
    temperature_walk_k_per_sqrt_s: float = parameter(0.0, 0.0, 10.0)
    thermal_ppm_per_k: float = parameter(8.2, 0.0, 1_000.0, source=THERMAL)
    # Light of classical traffic: launched power, its attenuation (None: that of the photons),
    # which way it goes, and what it scatters into a filter around the photons.
    classical_mw: float = parameter(0.0, 0.0, 1_000.0)
    classical_db_per_km: float | None = parameter(None, 0.0, 1_000.0)
    classical_way: str = choice("along", "against", source=OURS)
    raman_per_km_nm: float = parameter(2e-9, 0.0, 1e-3, source=RAMAN)
    filter_nm: float = parameter(0.4, 0.0, 100.0, source=f"{GRID}: 50 GHz")
    filter_center_nm: float = parameter(1550.12, 200.0, 5_000.0, source=f"{GRID}: 193.4 THz")
    pulse_window_s: float = parameter(1e-9, 0.0, 1e-3, source=OURS)
    # Channels by wavelength, behind a multiplexer at either end; 1: a fibre without multiplexers.
    # Channel 1 is at 193.4 THz (1550.12 nm), each further one so much higher.
    channels: int = parameter(1, 1, MOST_CHANNELS)
    grid_ghz: float = parameter(100.0, 12.5, 1_000.0, source=GRID)
    multiplexer_db: float = parameter(0.0, 0.0, 100.0)  # of both multiplexers together
    # Of light in a channel so much comes out in each neighbouring one; None: nothing.
    channel_crosstalk_db: float | None = parameter(None, 3.1, 200.0)
    # A user's own model: "path/to/file.py:ClassName" and the keywords to make it with.
    noise: str = ""
    noise_parameters: dict[str, Any] = field(default_factory=dict)

    @property
    def loss_db(self) -> float:
        """Attenuation from end to end, of each channel."""
        multiplexers_db = self.multiplexer_db if self.channels > 1 else 0.0
        return self.loss_db_per_km * self.length_km + self.connectors_db + multiplexers_db

    @property
    def grid_mhz(self) -> int:
        """How far neighbouring channels are from each other."""
        return round(self.grid_ghz * MHZ_PER_GHZ)

    def channel_mhz(self, channel: int) -> int:
        """Return the frequency of a channel, counted from 1."""
        return DEFAULT_FREQUENCY_MHZ + (channel - 1) * self.grid_mhz

    @property
    def dispersion_ps_per_nm(self) -> float:
        return self.dispersion_ps_per_nm_km * self.length_km

    @property
    def delay_s(self) -> float:
        return self.length_km * 1e3 / SPEED_IN_FIBER_M_PER_S

    def check(self, where: str) -> None:
        """Raise BadParameter if a value is out of range."""
        check(where, self)
        if self.pauli_x + self.pauli_y + self.pauli_z > 1 + SUM_TOLERANCE:
            values = f"pauli_x {self.pauli_x!r}, pauli_y {self.pauli_y!r}, pauli_z {self.pauli_z!r}"
            raise BadParameter(f"{where}: {values} are together more than 1")
        self._check_channels(where)
        named = self.noise in registered(NOISE) or all(self.noise.rpartition(":"))
        if self.noise and not named:
            raise BadParameter(f'{where}: noise {self.noise!r} is not "file.py:ClassName"')

    def _check_channels(self, where: str) -> None:
        if self.grid_mhz % CHANNEL_MHZ:
            raise BadParameter(
                f"{where}: grid_ghz {self.grid_ghz!r} is not a multiple of {CHANNEL_MHZ / 1e3:g}"
            )
        if self.channel_mhz(self.channels) > HIGHEST_CHANNEL_MHZ:
            most = (HIGHEST_CHANNEL_MHZ - DEFAULT_FREQUENCY_MHZ) // self.grid_mhz + 1
            raise BadParameter(
                f"{where}: {self.channels} channels with a grid of {self.grid_ghz:g} GHz do not "
                f"fit below {HIGHEST_CHANNEL_MHZ / 1e6:g} THz; choose {most} at most, or a "
                "narrower grid"
            )


@dataclass(frozen=True)
class Fiber(FiberOptics):
    """A fibre between two ports, or one channel of it."""

    a: FiberEnd
    b: FiberEnd
    channel: int = field(default=1, kw_only=True)
    # Names the fibre that a channel is of, the same for all of its channels.
    strand: str = field(default="", kw_only=True)

    @classmethod
    def joining(
        cls, a: FiberEnd, b: FiberEnd, optics: FiberOptics, channel: int = 1, strand: str = ""
    ) -> Self:
        return cls(a, b, channel=channel, strand=strand, **asdict(optics))

    @property
    def fixed_mhz(self) -> int | None:
        """The frequency of the channel that it is; None: light of any colour passes."""
        return self.channel_mhz(self.channel) if self.channels > 1 else None


def optics(where: str, **settings: Any) -> FiberOptics:
    """Return a fibre's optics: the given values, else those of its kind.

    Raise BadParameter for a name, a kind or a value that cannot be.
    """
    names = [item.name for item in fields(FiberOptics)]
    check_names(where, settings, names, BadParameter)
    kind = settings.get("kind", "ideal")
    result = FiberOptics(**{**KINDS.get(kind, {}), **settings})
    result.check(where)
    return result
