"""Presets, kinds and single parameters of all fibres of a topology."""

from math import log2
from pathlib import Path
from typing import Any

import pytest

from topologies.catalogue.presets import PRESETS, preset
from topologies.links.fiber import OPTICS, FiberLink, resolved
from topologies.sdc import SdcTopo
from wire.parameters.fiber import optics
from wire.parameters.physics import BadParameter


def fiber(**given: Any) -> dict[str, Any]:
    """Return the parameters of a fibre of the topology."""
    links = SdcTopo(**given).links(withInfo=True)
    return next(info for *_, info in links if info["cls"] is FiberLink)


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_can_be_and_cites_its_source(name: str) -> None:
    chosen = preset(name)
    optics(name, **chosen.fiber)
    chosen.device.check(name)
    assert name == "ideal" or "arXiv:" in chosen.source


def test_the_experiment_of_2017_has_its_capacity() -> None:
    fidelity = preset("fiber-2017").device.source.fidelity
    chances = [fidelity, *[(1 - fidelity) / 3] * 3]
    capacity = 2 + sum(probability * log2(probability) for probability in chances)
    assert abs(capacity - 1.665) < 0.001
    assert fidelity == pytest.approx(1 - 3 * 0.0598 / 4)


def test_what_is_given_goes_before_the_kind_and_the_kind_before_the_preset() -> None:
    metro = preset("metro").fiber
    assert fiber(preset="metro")["length_km"] == metro["length_km"] == 5
    assert optics("it", **_optics(fiber(preset="metro"))).loss_db == 1.5
    pm = optics("it", **_optics(fiber(preset="metro", kind="pm")))
    assert (pm.loss_db_per_km, pm.polarization_drift_rad_per_sqrt_km, pm.connectors_db) == (
        0.5,
        0.36,
        0.5,
    )
    given = fiber(preset="metro", kind="pm", loss_db_per_km=0.3)
    assert (given["loss_db_per_km"], given["connectors_db"]) == (0.3, 0.5)
    assert fiber(length_km=2)["length_km"] == 2


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"preset": "metropolis"}, "preset 'metropolis': did you mean metro?"),
        ({"preset": "metro", "length_km": -2}, "every fibre: length_km -2: choose 0 to 2000"),
        ({"kind": "pn"}, "kind 'pn': choose one of"),
        ({"length": 2}, "SdcTopo has no length: did you mean length_km"),
        ({"noise": "nowhere.py:Flicker"}, "there is no file /"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_built(
    given: dict[str, Any], text: str
) -> None:
    with pytest.raises(BadParameter, match=text):
        SdcTopo(**given)


def test_the_file_of_a_noise_model_is_found_from_where_the_program_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my_noise.py").touch()
    monkeypatch.chdir(tmp_path)
    found = resolved(optics("it", noise="my_noise.py:Flicker")).noise
    assert found == f"{tmp_path}/my_noise.py:Flicker"


def _optics(info: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in info.items() if name in OPTICS}
