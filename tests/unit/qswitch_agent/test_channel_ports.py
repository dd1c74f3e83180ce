"""Ports of channels as OpenFlow 1.4 describes and tunes them: each has one frequency."""

import pytest

from qswitch_agent.hardware.optics import Channel, Condition, Path, Tuning
from qswitch_agent.middleware.optical_ports import description, path_optics, tuned, tuning_of
from qswitch_agent.openflow.refusals import Refusal
from wire import optical
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


def test_what_paths_do_to_light_is_told_in_thousandths_of_a_decibel() -> None:
    """All that are not named come first; what is stuck is named. The field has 32 bits."""
    unlike = {(2, 4): Path(1.25, 3), (4, 2): Path(1e9)}
    condition = Condition(others=Path(0.5, 1), paths=unlike, stuck=frozenset({(1, 3)}))
    any_port = optical.ANY_PORT
    assert path_optics(condition) == [
        optical.PathOptics(any_port, any_port, 500, 1),
        optical.PathOptics(1, 3, 500, 1, stuck=True),
        optical.PathOptics(2, 4, 1250, 3),
        optical.PathOptics(4, 2, 2**32 - 1, 0),
    ]
