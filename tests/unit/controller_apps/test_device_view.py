"""Devices as the console and REST show them."""

from controller_apps.devices.hosts_state import in_use
from wire.device import OF_LIGHT, DeviceReport


def test_a_host_without_a_session_uses_nothing() -> None:
    assert in_use(DeviceReport(1)) == dict.fromkeys(OF_LIGHT)


def test_numbers_that_a_session_does_not_have_are_none() -> None:
    """Keys have no frames, and a session without channels no wavelength of its own."""
    found = in_use(DeviceReport(1, rate_hz=1_000_000, fec=0))
    assert (found["rate_hz"], found["frame_bytes"], found["wavelength_pm"]) == (
        1_000_000,
        None,
        None,
    )
    assert (found["fec"], found["interleave"]) == ("none", "off")
