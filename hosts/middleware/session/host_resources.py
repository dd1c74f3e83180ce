"""The resources of a host that its sessions share."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np

from hosts.hardware.qnic import Qnic
from hosts.middleware.session.encoding import DISTINGUISHABLE_STATES
from hosts.middleware.session.values import Lifetimes
from wire.features import NodeFeatures
from wire.optical import ANY_WAVELENGTH, frequency_mhz
from wire.outcomes import Pauli


class _Carrying:
    """Another QNIC with some of its ports."""

    def __init__(self, qnic: Qnic, ports: list[str]) -> None:
        self._qnic, self.ports = qnic, ports

    def __getattr__(self, name: str) -> Any:
        return getattr(self._qnic, name)


def carrying(qnic: Qnic, channels_mhz: Mapping[str, int], wavelength_pm: int) -> Qnic:
    """Return a QNIC whose ports are those that carry a wavelength, in order.

    `channels_mhz` has the frequency of each port that is a channel. Of any wavelength it is the
    channel of the first port. Raise ValueError for a wavelength outside the optical range.
    """
    first = channels_mhz.get(qnic.ports[0]) if qnic.ports else None
    channel_mhz = first if wavelength_pm == ANY_WAVELENGTH else frequency_mhz(wavelength_pm)
    ports = [port for port in qnic.ports if channels_mhz.get(port, channel_mhz) == channel_mhz]
    return cast(Qnic, _Carrying(qnic, ports))


@dataclass(frozen=True)
class HostResources:
    name: str
    seed: int
    qnic: Qnic
    analyser: str  # its kind of Bell analyser (wire.parameters.physics.ANALYSERS)
    pair_secrets: str  # folder of the secrets that hosts share two by two; "": there is none
    keys: str  # folder of this host's keys; "": there is none
    node_features: NodeFeatures
    multi_photon: float  # how likely a pulse of its source has several photons
    intensities: tuple[float, ...]  # mean photon numbers of its pulses: signal, then decoys
    lifetimes: Lifetimes  # of its memory
    addresses: Callable[[], Mapping[str, str]]  # of all hosts by name, read when one is asked for
    channels_mhz: Mapping[str, int] = field(
        default_factory=dict
    )  # of its interfaces that are channels
    shared: dict[str, Any] = field(default_factory=dict)  # what a service keeps between sessions

    def at(self, wavelength_pm: int) -> "HostResources":
        if not self.channels_mhz:
            return self
        return replace(self, qnic=carrying(self.qnic, self.channels_mhz, wavelength_pm))

    @property
    def distinguishable_states(self) -> frozenset[int]:
        if DISTINGUISHABLE_STATES[self.analyser] == len(Pauli):
            return frozenset(range(4))
        return frozenset({1, 3})  # it reports Phi- as Phi+ (wire/dispatcher.proto, Feedback)

    def draws(self, session: int) -> np.random.Generator:
        """Return the choices of this host in a session; the same seed, the same choices."""
        return np.random.default_rng([self.seed, session, *self.name.encode()])
