"""The resources of a host that its sessions share."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from hosts.hardware.channels import carrying
from hosts.hardware.qnic import Qnic
from hosts.middleware.qkd.keyring import Keyring
from hosts.middleware.session.encoding import DISTINGUISHABLE_STATES
from hosts.middleware.session.swap_orders import Swaps
from hosts.middleware.session.values import Lifetimes
from wire.features import NodeFeatures
from wire.outcomes import Pauli


@dataclass(frozen=True)
class HostResources:
    """The resources of one host, shared by its sessions."""

    name: str
    seed: int
    qnic: Qnic
    analyser: str  # its kind of Bell analyser (wire.parameters.physics.ANALYSERS)
    keyring: Keyring  # what this host shares with others
    swaps: Swaps  # the chains of repeaters that it is part of
    node_features: NodeFeatures
    multi_photon: float  # how likely a pulse of its source has several photons
    intensities: tuple[float, ...]  # mean photon numbers of its pulses: signal, then decoys
    lifetimes: Lifetimes  # of its memory
    addresses: Callable[[], Mapping[str, str]]  # of all hosts by name, read when one is asked for
    channels_mhz: Mapping[str, int] = field(
        default_factory=dict
    )  # of its interfaces that are channels

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
