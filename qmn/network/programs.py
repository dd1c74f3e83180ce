"""Programs of packages that `qmn cli` can start beside the network."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from qmn.network.options import NetworkOptions
from topologies.networks.network import Network

Start = Callable[[Network], Mapping[str, str]]  # returns what to print, by name


@dataclass(frozen=True)
class NetworkProgram:
    """Options of programs, a dataclass, and how they start.

    `prepare` takes them and the hosts; it returns None if no program is wanted, or raises BadInput.
    `network` changes the network to one that the programs need.
    """

    options: type[Any]
    prepare: Callable[[Any, Sequence[str]], Start | None]
    network: Callable[[Any, NetworkOptions], NetworkOptions] = lambda _options, network: network
