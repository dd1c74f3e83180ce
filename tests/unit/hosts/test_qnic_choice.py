"""The hardware that a host's configuration names."""

from dataclasses import replace
from pathlib import Path

import pytest

from hosts import network_loop
from hosts.hardware.qnic import Qnic
from hosts.hardware.simulated import SimulatedQnic, chosen_qnic
from wire.config import BadConfig, HostConfig

CONFIG = HostConfig(
    name="alice",
    address="10.0.0.1",
    qnics=["alice-q0"],
    dispatcher="10.0.0.4:50051",
    token="secret",
    socket="/nowhere",
    hosts_file="",
    source="charlie",
    seed=1,
)
OWN = """
from hosts.hardware.simulated import SimulatedQnic


class Dimmed(SimulatedQnic):
    def __init__(self, dispatcher, token, ports, by_db=0.0):
        if by_db < 0:
            raise ValueError(f"by_db {by_db}")
        super().__init__(dispatcher, token, ports)
        self.by_db = by_db


class Empty:
    pass


something = 7
"""


def own(folder: Path, name: str, text: str = OWN) -> HostConfig:
    """Return the configuration of a host with a class from a file of its own."""
    (folder / "own.py").write_text(text)
    return replace(CONFIG, qnic=f"{folder / 'own.py'}:{name}")


def made(config: HostConfig) -> Qnic:
    """Return the hardware, closed again."""

    async def make() -> Qnic:
        qnic = chosen_qnic(config)
        await qnic.close()
        return qnic

    return network_loop.run(make())


def test_hardware_is_simulated_if_nothing_is_said() -> None:
    assert type(made(CONFIG)) is SimulatedQnic


def test_a_class_of_the_users_own_is_made_with_its_keywords(tmp_path: Path) -> None:
    qnic = made(replace(own(tmp_path, "Dimmed"), qnic_parameters={"by_db": 3.0}))
    assert (type(qnic).__name__, qnic.ports) == ("Dimmed", ["alice-q0"])
    assert vars(qnic)["by_db"] == 3.0


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("Bright", OWN, "has no class Bright"),
        ("something", OWN, "has no class something"),
        ("Empty", OWN, "Empty is not a subclass of Qnic; derive it from"),
        (
            "Dark",
            "from hosts.hardware.qnic import Qnic\nclass Dark(Qnic): pass",
            "Dark has no arrivals, begin, close, finish, give_up, look, perform, perform",
        ),
        ("Dimmed", "import nowhere_to_be_found", "cannot be loaded: No module named"),
        ("Dimmed", "class Dimmed(", "cannot be loaded"),
    ],
)
def test_a_class_that_cannot_be_hardware_is_refused(
    tmp_path: Path, name: str, text: str, message: str
) -> None:
    with pytest.raises(BadConfig, match=message):
        chosen_qnic(own(tmp_path, name, text))


@pytest.mark.parametrize("given", [{"by_db": -1.0}, {"power": 7}])
def test_keywords_that_the_class_does_not_take_are_refused(
    tmp_path: Path, given: dict[str, float]
) -> None:
    with pytest.raises(BadConfig, match=f"with {given}"):
        chosen_qnic(replace(own(tmp_path, "Dimmed"), qnic_parameters=given))


def test_what_names_no_file_or_no_class_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadConfig, match="there is no file"):
        chosen_qnic(replace(CONFIG, qnic=f"{tmp_path}/nowhere.py:Dimmed"))
    with pytest.raises(BadConfig, match="given without qnic"):
        chosen_qnic(replace(CONFIG, qnic_parameters={"by_db": 1.0}))
