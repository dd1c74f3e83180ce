"""The package of examples/plugin, beside the tree: each door, and what is broken or clashes."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from limits import SOON_S

ROOT = Path(__file__).resolve().parents[3]
PLUGIN = ROOT / "examples" / "plugin"
PAGE = (ROOT / "docs" / "adding-a-service.md").read_text()
TRY = """
import json, sys
from pathlib import Path
from stacks_scene import ask

if __name__ == "__main__":
    print(json.dumps(ask(Path(sys.argv[1]), "coin", count=20_000)))
"""
SERVICES = "import wire.services as w; print([each.name for each in w.LIGHT][-1])"
DOORS = """
import json
from controller_apps.policy.reading import read_policy
from controller_apps.policy.schedules import ORDERS, Waiting
from evidence.labs import catalogue
from qmn.network.custom_topology import load
from topologies.catalogue.maps import read_map
from topologies.catalogue.node_kinds import node_device
from wire.parameters.physics import Device

order = ORDERS[read_policy("lifo").queue.order]
print(json.dumps({
    "next": sorted([1.0, 3.0, 2.0], key=lambda since: order(Waiting(since))),
    "km": [link.length_km for link in read_map("village").links],
    "switches": load("corridor", {"switches": 3})().switches(),
    "misread": node_device("worn", Device()).detectors.noise_parameters["misread"],
    "lab": [catalogue.lab("coins").theirs, catalogue.names()[-1]],
}))
"""
DISSECT = """
import json, sys
from pathlib import Path
from coin.tally import TOPIC, Tally
from dissection import segment, shown
from wire.metadata.values import Envelope

frames = [segment(Envelope(1, TOPIC, data).encode(), n) for n, data in enumerate(
    [Tally(7, 5).encode(), b"1234567", Tally(5, 7).encode()])]
fields = ["coin.thrown", "coin.agreed", "coin.malformed"]
print(json.dumps(shown(Path(sys.argv[1]), frames, fields)))
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Return a folder with the package, installed as pip does it."""
    shutil.copytree(PLUGIN / "coin", tmp_path / "coin")
    project = tomllib.loads((PLUGIN / "pyproject.toml").read_text())["project"]
    metadata = tmp_path / "coin-1.dist-info"
    metadata.mkdir()
    lines = list[str]()
    for group, entries in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {value}" for name, value in entries.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines))
    return tmp_path


def replaced(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert text.count(old) == 1
    file.write_text(text.replace(old, new))


def python(package: Path, *words: str) -> subprocess.CompletedProcess[str]:
    tests = ROOT / "tests"
    folders = ROOT, package, tests, tests / "unit" / "hosts", tests / "unit" / "views"
    return subprocess.run(
        [sys.executable, *words],
        env={**os.environ, "PYTHONPATH": ":".join(map(str, folders))},
        capture_output=True,
        text=True,
        timeout=SOON_S,
    )


def printed(package: Path, *words: str) -> Any:
    done = python(package, *words)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_page_shows_the_package_as_it_is() -> None:
    shown = re.findall(r"<!-- (\S+) -->\n```\w+\n(.*?)```", PAGE, re.DOTALL)
    assert {name for name, _text in shown} >= {"pyproject.toml", "coin/service.py", "coin/ends.py"}
    for name, text in shown:
        assert text in (PLUGIN / name).read_text(), name


def test_both_ends_of_its_service_throw_the_same_coins(
    package: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    sockets = tmp_path_factory.mktemp("coin")  # a short path, as sockets need
    (package / "try_it.py").write_text(TRY)
    opener, acceptor = printed(package, str(package / "try_it.py"), str(sockets))
    assert opener == acceptor == {"coins": 20_000, "agreed": 20_000}


def test_its_service_is_a_job(package: Path) -> None:
    usage = python(package, "-m", "qmn", "run", "coin", "--help").stdout
    assert "throw coins that two hosts have in common" in usage
    assert "--count" in usage


def test_its_scheduler_map_topology_node_and_lab_are_there_by_name(package: Path) -> None:
    assert printed(package, "-c", DOORS) == {
        "next": [3.0, 2.0, 1.0],
        "km": [1.5, 0.7],
        "switches": ["q1", "q2", "q3", "s1"],
        "misread": 0.25,
        "lab": ["closed form", "coins"],
    }


def test_tshark_shows_its_fields(package: Path, tmp_path: Path) -> None:
    whole, cut, wrong = printed(package, "-c", DISSECT, str(tmp_path))
    assert (whole["coin.thrown"], whole["coin.agreed"]) == (["7"], ["5"])
    assert not whole["coin.malformed"]
    assert cut["coin.malformed"]
    assert wrong["coin.malformed"]


DEVICES = """
import json, sys
from qmn.network.custom_topology import BadTopology
from qmn.network.part_options import _changed_devices

def detectors(words):
    try:
        return str(_changed_devices({}, words)["bob"].detectors)
    except BadTopology as error:
        return str(error)

print(json.dumps([detectors(line.split()) for line in sys.argv[1:]]))
"""


def test_the_parameter_of_its_noise_is_one_of_a_device(package: Path) -> None:
    done = printed(
        package,
        "-c",
        DEVICES,
        "bob.detectors.wear.misread=0.1 bob.detectors.efficiency=0.5",
        "bob.analyser.wear.misread=0.1",
        "bob.detectors.tear.misread=0.1",
        "bob.detectors.wear.misread=much",
        "bob.detectors.noise=a.py:Rust bob.detectors.wear.misread=0.1",
    )
    assert "noise='wear', noise_parameters={'misread': 0.1}" in done[0]
    assert "efficiency=0.5" in done[0]
    assert "analyser has no noise" in done[1]
    assert "detectors has no tear.misread" in done[2]
    assert "choose a number" in done[3]
    assert "detectors has the noise a.py:Rust: choose one of both" in done[4]


def test_a_package_that_cannot_be_loaded_is_named_and_left_out(package: Path) -> None:
    (package / "coin" / "service.py").write_text("import nowhere\n")
    done = python(package, "-c", SERVICES)
    assert done.stdout == python(ROOT, "-c", SERVICES).stdout
    why = "ModuleNotFoundError: No module named 'nowhere'"
    assert f"coin (coin.service:COIN) is left out: {why}" in done.stderr


NAMES = {
    "from topologies.catalogue.node_kinds import NODE_KINDS as names": "coin/physics.py",
    "from controller_apps.policy.schedules import ORDERS as names": "coin/scheduler.py",
    "from controller_apps.policy.reading import POLICIES as names": "coin/__init__.py",
    "from topologies.catalogue.maps import PACKAGES as names": "coin/__init__.py",
    "from evidence.labs.catalogue import names; names = names()": "coin/lab.py",
    "from qmn.requests.service_verbs import VERBS as names": "coin/verb.py",
    "from views.dissection.dissectors import PACKAGES as names": "coin/dissection.py",
    "from hosts.middleware.services import named; names = named()": "coin/ends.py",
}
ALL_NAMES = f"""
import json
found = []
for text in {[*NAMES]}:
    exec(text)
    found.append(sorted(names))
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def without() -> dict[str, Any]:
    """Return the names at each door where the package is not installed."""
    return dict(zip(NAMES, printed(ROOT, "-c", ALL_NAMES), strict=True))


def test_a_package_adds_its_names_at_each_door(package: Path, without: dict[str, Any]) -> None:
    found = dict(zip(NAMES, printed(package, "-c", ALL_NAMES), strict=True))
    assert all(len(names) > len(without[door]) for door, names in found.items())


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize(
    "fault", ["1 / 0\n", "COIN = WORN = LIFO = VILLAGE = LAB = LUA = KIND = last_come = 7\n"]
)
@pytest.mark.parametrize(("names", "file"), NAMES.items(), ids=list(NAMES.values()))
def test_a_door_leaves_out_what_is_broken_and_names_it(
    package: Path, names: str, file: str, fault: str, without: dict[str, Any]
) -> None:
    (package / file).write_text(fault)
    done = python(package, "-c", f"{names}; import json; print(json.dumps(sorted(names)))")
    assert json.loads(done.stdout) == without[names]
    assert re.search(r"qmn\.\w+: \w+ \(coin[\w.:]*\) is left out: ", done.stderr)


def test_a_service_without_its_ends_is_refused_by_name(package: Path) -> None:
    (package / "coin" / "ends.py").write_text("1 / 0\n")
    done = python(package, "-m", "qmn", "run", "coin")
    assert (done.returncode, "Traceback" in done.stderr) == (2, False)
    assert "coin cannot be used: its package is left out" in done.stderr


def test_a_message_without_a_number_is_left_out(package: Path) -> None:
    text = "from wire.metadata.header import Message\nclass Mute(Message): pass\n"
    (package / "coin" / "mute.py").write_text(text)
    points = package / "coin-1.dist-info" / "entry_points.txt"
    points.write_text(f"{points.read_text()}\n[qmn.datagrams]\nmute = coin.mute:Mute\n")
    done = python(package, "-c", "from wire.device import kinds; print(len(kinds()))")
    assert (
        done.stdout
        == python(ROOT, "-c", "from wire.device import kinds; print(len(kinds()))").stdout
    )
    assert "qmn.datagrams: mute (coin.mute:Mute) is left out: " in done.stderr


def test_its_topic_is_none_of_qmn_s_own(package: Path) -> None:
    text = "from coin.tally import TOPIC; from wire.metadata.values import FREE_TOPIC, Topic"
    assert printed(package, "-c", f"{text}; print(int(max(Topic) < FREE_TOPIC <= TOPIC))") == 1
    assert "topic of 128 (`FREE_TOPIC`" in PAGE


def test_a_broken_noise_model_is_named_when_it_is_asked_for(package: Path) -> None:
    (package / "coin" / "physics.py").write_text("1 / 0\n")
    done = python(package, "-c", "from dispatcher.fiber.custom_noise import load; load('wear', {})")
    assert "noise wear (coin.physics:Wear) is left out: ZeroDivisionError" in done.stderr


@pytest.mark.parametrize(
    ("old", "new", "refusal"),
    [
        ("number=100", "number=14", "two registered services have the number 14: remove one"),
        ('name="coin"', 'name="sense"', "two registered services have the name sense: remove one"),
        ("number=100", "number=1", "service coin: qmn has its name or number; choose others"),
        ('name="coin"', 'name="sdc"', "service sdc: qmn has its name or number; choose others"),
    ],
)
def test_a_clash_of_services_is_refused(package: Path, old: str, new: str, refusal: str) -> None:
    replaced(package / "coin" / "service.py", old, new)
    done = python(package, "-c", SERVICES)
    assert (done.returncode, refusal in done.stderr) == (1, True), done.stderr


def test_a_number_that_no_set_up_message_can_have_is_left_out(package: Path) -> None:
    replaced(package / "coin" / "service.py", "number=100", "number=256")
    assert (
        "ValueError: service coin: number 256: choose 100" in python(package, "-c", SERVICES).stderr
    )


@pytest.mark.parametrize(
    ("old", "new", "program"),
    [
        ("worn = ", "ion-trap = ", "qmn.network.options"),
        ("lifo = coin.s", "edf = coin.s", "controller_apps.policy.reading"),
        ("lifo = coin:", "deny = coin:", "qmn.network.options"),
        ("corridor = ", "ring = ", "qmn.network.topologies"),
        ("coins = ", "seal = ", "evidence.labs.catalogue"),
        ("coin = coin.verb", "distribute = coin.verb", "qmn.requests.service_verbs"),
    ],
)
def test_a_name_of_qmn_s_own_is_refused(package: Path, old: str, new: str, program: str) -> None:
    replaced(package / "coin-1.dist-info" / "entry_points.txt", old, new)
    text = f"import {program} as m; getattr(m, 'ORDERS', getattr(m, 'POLICIES', {{}})).get('a')"
    look = "; getattr(m, 'names', list)(); getattr(m, 'policy_file', str)('a')"
    done = python(package, "-c", text + look)
    assert done.returncode == 1
    assert "qmn has this name itself; rename it" in done.stderr
