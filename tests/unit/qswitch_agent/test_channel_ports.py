"""Ports of channels as OpenFlow 1.4 describes and tunes them: each has one frequency."""

import pytest

from qswitch_agent.hardware.optics import Channel, Condition, Tuning
from qswitch_agent.middleware.optical_ports import description, tuned, tuning_of
from qswitch_agent.openflow.refusals import Refusal
from wire.optical import RX_TUNE, TUNABLE, TX_PWR, TX_TUNE, USE_FREQ, PortOptics, PortTuning

CONDITION = Condition(
    Tuning(191_350_000, 196_100_000, 50_000, -20.0, 0.0),
    channels={2003: Channel(193_500_000, 100_000)},
)


def test_the_port_of_a_channel_has_one_frequency_and_cannot_be_tuned() -> None:
    fixed = 193_500_000, 193_500_000, 100_000
    wanted = PortOptics(TX_PWR | USE_FREQ, *fixed, *fixed, -200, 0)
    assert description(CONDITION, 2003) == wanted
    tunable = description(CONDITION, 3)
    assert (tunable.supported, tunable.tx_min_mhz) == (TUNABLE, 191_350_000)


def test_a_port_mod_to_another_frequency_than_the_channels_is_refused() -> None:
    def asked(frequency: int) -> PortTuning:
        return PortTuning(RX_TUNE | TX_TUNE | USE_FREQ, frequency, 0, 0, 0)

    tuning = tuning_of(CONDITION, 2003)
    assert tuned(asked(193_500_000), tuning).frequency_mhz == 193_500_000
    with pytest.raises(Refusal, match="193400000 MHz: ports are tuned to 193500000"):
        tuned(asked(193_400_000), tuning)


@pytest.mark.parametrize("offset_mhz", [-50_000, 0, 100_000])
def test_the_offset_of_a_port_mod_is_signed_and_counts(offset_mhz: int) -> None:
    """OpenFlow 1.4, 7.3.4.3: fl_offset is the offset from the frequency in freq_lmda."""
    asked = PortTuning(TX_TUNE | USE_FREQ, 193_400_000, offset_mhz, 0, 0)
    assert tuned(asked, CONDITION.tuning).frequency_mhz == 193_400_000 + offset_mhz
