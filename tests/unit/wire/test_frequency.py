"""The channel that light of a wavelength is in."""

import pytest

from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, Service
from wire.optical import DEFAULT_FREQUENCY_MHZ, frequency_mhz


def test_light_is_in_the_default_channel_unless_a_session_says_otherwise() -> None:
    setup = Setup(1, Service.SDC, Handshake.FRAMED, "10.0.0.3", 1, 1, 1)
    assert frequency_mhz(setup.wavelength_pm) == DEFAULT_FREQUENCY_MHZ


@pytest.mark.parametrize(
    ("wavelength_pm", "channel_mhz"),
    # ITU-T G.694.1, table 1: channels of the 12.5 GHz grid near 193.1 THz.
    [(1_552_524, 193_100_000), (1_552_424, 193_112_500), (1_551_721, 193_200_000)],
)
def test_wavelengths_are_in_the_channels_of_the_standard(
    wavelength_pm: int, channel_mhz: int
) -> None:
    assert frequency_mhz(wavelength_pm) == channel_mhz


@pytest.mark.parametrize("wavelength_pm", [-1, 0, 99_999, 10_000_001])
def test_what_is_no_wavelength_of_light_has_no_channel(wavelength_pm: int) -> None:
    with pytest.raises(ValueError, match=f"wavelength {wavelength_pm} pm is not 100000 to"):
        frequency_mhz(wavelength_pm)
