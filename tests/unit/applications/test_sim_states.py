"""netqasm.sdk.toolbox.sim_states as programs import it, against closed forms."""

from math import cos, pi, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from netqasm_scene import outputs
from test_bundled_applications import qubit

from applications.netqasm.sim_states import get_fidelity, qubit_from, to_dm

ANGLES = [(0, 0), (0.3, 1.2), (pi / 2, pi / 2), (5, 3)]


@pytest.mark.parametrize(("phi", "theta"), ANGLES)
def test_a_qubit_has_the_bloch_vector_of_its_angles(phi: float, theta: float) -> None:
    x, y, z = sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta)
    expected = np.array([[1 + z, x - 1j * y], [x + 1j * y, 1 - z]]) / 2
    assert np.allclose(to_dm(qubit_from(phi, theta)), expected)


def test_fidelity_is_not_squared_as_in_netsquid() -> None:
    """NetSquid's qubitapi.fidelity has squared=False: |<a|b>| = cos of half the angle between."""
    zero, turned = qubit_from(0, 0), qubit_from(0.7, 1.1)
    column = turned.reshape(2, 1)
    for other in (turned, column, to_dm(turned), to_dm(column)):
        assert get_fidelity(zero, other) == pytest.approx(cos(1.1 / 2))
    mixed = np.diag([0.7, 0.3])
    assert get_fidelity(zero, mixed) == pytest.approx(sqrt(0.7))
    # Of matrices that commute: the sum of roots of the products of their eigenvalues.
    both = sqrt(0.7 * 0.2) + sqrt(0.3 * 0.8)
    assert get_fidelity(mixed, np.diag([0.2, 0.8])) == pytest.approx(both)
    werner = 0.9 * to_dm(np.array([1, 0, 0, 1]) / sqrt(2)) + 0.1 * np.eye(4) / 4
    assert get_fidelity(np.array([1, 0, 0, 1]) / sqrt(2), werner) == pytest.approx(sqrt(0.925))


def test_a_program_compares_what_it_has_prepared(tmp_path: Path) -> None:
    def alice(app_config: Any) -> Any:
        from netqasm.sdk import Qubit
        from netqasm.sdk.external import NetQASMConnection, get_qubit_state
        from netqasm.sdk.toolbox import set_qubit_state, sim_states
        from netqasm.sdk.toolbox.sim_states import get_fidelity, qubit_from

        assert sim_states.get_fidelity is get_fidelity
        with NetQASMConnection("alice") as unit:
            prepared = Qubit(unit)
            set_qubit_state(prepared, phi=0.3, theta=1.2)
            return get_fidelity(qubit_from(0.3, 1.2), get_qubit_state(prepared))

    (report,) = outputs(tmp_path, {"alice": alice}, {"alice": "alice"}, state_inspection=True)
    assert report["alice"] == pytest.approx(1, abs=1e-6)
    assert np.allclose(to_dm(qubit(0.3, 1.2)), to_dm(qubit_from(0.3, 1.2)))
