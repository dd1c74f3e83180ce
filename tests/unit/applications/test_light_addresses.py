"""The addresses of q0."""

import pytest

from applications.ip_over_light.interfaces import light_address


@pytest.mark.parametrize(
    ("copper", "light"),
    [("10.0.0.2", "10.1.0.2"), ("10.0.3.77", "10.1.3.77"), ("192.168.7.9", "10.1.7.9")],
)
def test_a_host_has_its_own_number_on_light(copper: str, light: str) -> None:
    assert light_address(copper) == light
