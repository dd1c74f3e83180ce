"""The ports that a session has of a host whose fibres have channels."""

from typing import cast

import pytest

from hosts.hardware.qnic import Qnic
from hosts.middleware.session.host_resources import carrying
from wire.optical import ANY_WAVELENGTH

# Two fibres of two channels, in the order of their interfaces, and a fibre without channels.
PORTS = ["bob-q0", "bob-q1", "bob-q2", "bob-q3", "bob-q4"]
CHANNELS_MHZ = {
    "bob-q0": 193_400_000,
    "bob-q1": 193_500_000,
    "bob-q2": 193_400_000,
    "bob-q3": 193_500_000,
}


class Hardware:
    """A QNIC as far as it matters here."""

    ports = PORTS

    def origin(self) -> str:
        return "the hardware's own"


@pytest.mark.parametrize(
    ("wavelength_pm", "ports"),
    [
        (1_550_120, ["bob-q0", "bob-q2", "bob-q4"]),  # 193.4 THz
        (1_549_320, ["bob-q1", "bob-q3", "bob-q4"]),  # 193.5 THz
        (1_548_510, ["bob-q4"]),  # 193.6 THz
        (ANY_WAVELENGTH, ["bob-q0", "bob-q2", "bob-q4"]),
    ],
)
def test_a_session_has_one_port_of_each_fibre(wavelength_pm: int, ports: list[str]) -> None:
    tuned = carrying(cast(Qnic, Hardware()), CHANNELS_MHZ, wavelength_pm)
    assert tuned.ports == ports
    assert cast(Hardware, tuned).origin() == "the hardware's own"
