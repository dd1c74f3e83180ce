"""The imports that each room may have."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from qmn.__main__ import MODULES

ROOT = Path(__file__).resolve().parents[2]
PRODUCT = (
    "wire",
    "programs",
    "dispatcher",
    "hosts",
    "controller_apps",
    "qswitch_agent",
    "copper",
    "gate",
    "topologies",
)
RINGS = ("applications", "course", "evidence", "views")  # around the core
NAMES_AROUND = ("applications.", "evidence.")
ALL = (*PRODUCT, "qmn", *RINGS, "tests")
MOST_LINES = 540
GRPC = ("dispatcher", "hosts/hardware", "qswitch_agent", "qmn", "wire")


@cache
def parsed(file: Path) -> ast.Module:
    """Return a file's syntax tree, which many tests look at."""
    return ast.parse(file.read_text())


@cache
def nodes(file: Path) -> list[ast.AST]:
    """Return all of a file's syntax tree."""
    return list(ast.walk(parsed(file)))


@cache
def statements(file: Path) -> list[ast.Import | ast.ImportFrom]:
    """Return where a file imports something, wherever it does so."""
    return [node for node in nodes(file) if isinstance(node, ast.Import | ast.ImportFrom)]


def imports(file: Path) -> Iterator[str]:
    """Yield the name of every module that a file imports."""
    for node in statements(file):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        else:
            yield node.module or ""


def sources(folder: str) -> list[Path]:
    """Return the files of a folder that people wrote."""
    return [file for file in (ROOT / folder).rglob("*.py") if "_pb2" not in file.name]


def test_a_product_folder_imports_only_wire_programs_and_itself() -> None:
    for folder in PRODUCT:
        assert sources(folder)
        shared = {"wire"} if folder == "wire" else {"wire", "programs"}
        for file in sources(folder):
            ours = {name.split(".")[0] for name in imports(file)} & set(ALL)
            assert ours <= {*shared, folder}, file


def test_the_core_names_no_package_around_it() -> None:
    """It finds them by their entry points; only the command line itself draws views."""
    for folder in [*PRODUCT, "qmn", "views"]:
        others = set(RINGS) - ({"views"} if folder in ("qmn", "views") else set())
        for file in sources(folder):
            assert not {name.split(".")[0] for name in imports(file)} & others, file
            names = [n.value for n in nodes(file) if isinstance(n, ast.Constant)]
            assert not [n for n in names if isinstance(n, str) and n.startswith(NAMES_AROUND)], file


def test_only_topologies_imports_mininet() -> None:
    for folder in [folder for folder in PRODUCT if folder != "topologies"]:
        for file in sources(folder):
            assert "mininet" not in {name.split(".")[0] for name in imports(file)}, file


def test_grpc_stays_where_it_belongs() -> None:
    for folder in PRODUCT:
        for file in sources(folder):
            path = str(file.relative_to(ROOT))
            loads_grpc = any(name == "grpc" or name.endswith("_pb2_grpc") for name in imports(file))
            assert not loads_grpc or path.startswith(GRPC), file


def test_no_framework_of_controllers_is_loaded_but_by_name() -> None:
    for folder in PRODUCT:
        for file in sources(folder):  # to load one takes a third of a second
            packages = {name.partition(".")[0] for name in imports(file)}
            assert packages.isdisjoint({"os_ken", "ryu"}), file


def test_wire_imports_nothing_by_itself() -> None:
    assert list(imports(ROOT / "wire" / "__init__.py")) == []


def room_of(file: Path) -> str:
    """Return the folder of a file; a file at the top of a product folder is a room by itself."""
    path = file.relative_to(ROOT)
    return str(path.parent if len(path.parts) > 2 else path)


@cache
def modules() -> dict[str, Path]:
    """Return the files of the product by the names under which they are imported."""
    return {
        ".".join(file.relative_to(ROOT).with_suffix("").parts): file
        for folder in ALL[:-1]
        for file in sources(folder)
    }


def arrows() -> dict[str, set[str]]:
    """Return which rooms each room imports; packages and entry points stand above their folder."""
    found: dict[str, set[str]] = {}
    for file in modules().values():
        if file.name in ("__init__.py", "__main__.py"):
            continue
        for name in members(file):
            if name in modules() and (there := room_of(modules()[name])) != room_of(file):
                found.setdefault(room_of(file), set()).add(there)
    return found


def members(file: Path) -> Iterator[str]:
    """Yield what a file imports, also as members of modules, which may be modules themselves."""
    yield from imports(file)
    for node in statements(file):
        if isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("storeys", [2, 99], ids=["with all that is in them", "each by itself"])
def test_no_rooms_import_each_other_even_by_way_of_others(storeys: int) -> None:
    found: dict[str, set[str]] = {}
    for room, others in arrows().items():
        here = shortened(room, storeys)
        found.setdefault(here, set()).update({shortened(each, storeys) for each in others} - {here})
    try:
        list(TopologicalSorter(found).static_order())
    except CycleError as error:
        pytest.fail(f"a circle: {' <- '.join(error.args[1])}")


def test_no_files_import_each_other_even_by_way_of_others_or_for_types_alone() -> None:
    found = {name: set(members(file)) & modules().keys() for name, file in modules().items()}
    try:
        list(TopologicalSorter(found).static_order())
    except CycleError as error:
        pytest.fail(f"a circle: {' <- '.join(error.args[1])}")


def shortened(room: str, storeys: int) -> str:
    """Return the folder of this storey that a room is in."""
    return "/".join(room.split("/")[:storeys])


def test_the_top_of_topologies_holds_topologies_alone() -> None:
    """`mn --custom` takes each of these files; their bases and the waits are beside them."""
    for file in (ROOT / "topologies").glob("*.py"):
        names = {
            target.id
            for node in parsed(file).body
            if isinstance(node, ast.Assign)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        beside = file.name in ("__init__.py", "fabric.py", "quantum_topo.py", "timeouts.py")
        assert ("topos" in names) != beside, file


def test_the_machinery_of_networks_knows_no_topology_by_name() -> None:
    top = {f"topologies.{file.stem}" for file in (ROOT / "topologies").glob("*.py")}
    for file in sources("topologies"):
        if file.parent != ROOT / "topologies":
            assert not set(members(file)) & (top - {"topologies.timeouts"}), file


SERVICES = "hosts/middleware/services"
ROOMS = (
    *("conference", "ghz", "graph_states", "interception", "key_distribution", "qkd"),
    *("sealing", "sensing", "teleportation"),
)
AROUND = [f"applications/{name}" for name in ROOMS]
# The performers of effects and operations of QNICs; all other modules are protocols.
CARRIERS = {
    "applications/conference/conference.py",
    "applications/ghz/connections.py",
    "applications/ghz/ends.py",
    "applications/graph_states/ends.py",
    "applications/interception/interception.py",
    "applications/interception/photons.py",
    "applications/key_distribution/key_handout.py",
    "applications/key_distribution/session.py",
    "applications/qkd/dissection.py",
    "applications/qkd/keyring.py",
    "applications/qkd/scapy_keys.py",
    "applications/sealing/seal.py",
    "applications/sensing/ends.py",
    "applications/sensing/sensors.py",
    "applications/teleportation/along.py",
    "applications/teleportation/teleport.py",
    f"{SERVICES}/distribution/delivery.py",
    f"{SERVICES}/superdense/superdense.py",
}
# Messages of an end of a session and its answers to messages; others carry them.
PROTOCOLS = [
    *(
        ROOT / "hosts" / "middleware" / "session" / f"{name}.py"
        for name in ("node_features", "blocks", "errors", "mailbox", "protocol", "values")
    ),
    ROOT / SERVICES / "source.py",
    *(
        file
        for rooms in (f"{SERVICES}/*/**", *AROUND)
        for file in sorted(ROOT.glob(f"{rooms}/[a-z]*.py"))
        if str(file.relative_to(ROOT)) not in CARRIERS
    ),
]


def test_what_carries_protocols_out_is_still_there() -> None:
    assert not {name for name in CARRIERS if not (ROOT / name).exists()}


def test_a_protocol_knows_no_socket_clock_or_thread() -> None:
    for file in PROTOCOLS:
        for used in with_all_it_imports(file):
            edges = {"asyncio", "socket", "time", "threading", "grpc", "hosts.network_loop"}
            assert not edges & set(imports(used)), used
        waits = ast.AsyncFunctionDef | ast.Await | ast.AsyncFor | ast.AsyncWith
        assert not any(isinstance(node, waits) for node in nodes(file)), file


def with_all_it_imports(file: Path) -> set[Path]:
    """Return a file and those of ours that it imports, also by way of others."""
    found, left = set[Path](), [file]
    while left:
        if (one := left.pop()) not in found:
            found.add(one)
            paths = (ROOT / f"{name.replace('.', '/')}.py" for name in members(one))
            left += [path for path in paths if path.exists()]
    return found


def test_the_docstring_of_a_module_says_what_the_module_is() -> None:
    for folder in ALL:
        for file in sources(folder):
            words = (ast.get_docstring(parsed(file)) or "").split()
            assert not words or words[0] not in ("What", "Which"), file


def test_which_openflow_error_answers_what_stands_in_one_table() -> None:
    for file in sources("qswitch_agent"):
        calls = [n for n in nodes(file) if isinstance(n, ast.Call)]
        named = {call.func.id for call in calls if isinstance(call.func, ast.Name)}
        assert "Refusal" not in named or file.name == "refusals.py", file


TIME = re.compile(r"(?!.*_PER_S$)[A-Z][A-Z0-9_]*_M?S")
# Times that nothing waits for: ranges and parameters of a user's settings, physics, values in
# messages, and constants of calculations.
NOT_WAITS = {
    "controller_apps/policy/reading.py": {"SLOT_S"},
    "dispatcher/fiber/classical_light.py": {"PLANCK_J_S"},
    "dispatcher/operations/limits.py": {"MAX_EMISSION_S"},
    "hosts/applications/carrying.py": {"LIGHT_S"},
    "applications/keys/link_states.py": {"RATE_WINDOW_S"},
    "hosts/middleware/session/options.py": {"LATEST_MS"},
    "evidence/attacks/frames.py": {"TTL_S"},
    "evidence/networks/control.py": {"WAITED_S"},
    "qmn/jobs/superdense.py": {"TELL_ESTIMATE_ABOVE_S"},
    "applications/keys/request.py": {"MOST_S"},
    "applications/vpn/request.py": {"DEFAULT_S"},
    "evidence/curves/contention.py": {"FOR_EVER_S"},
    "evidence/curves/bb84.py": {"GATE_S"},
    "evidence/curves/memories.py": {"ATTEMPT_S", "MAX_S"},
    "evidence/curves/packets.py": {"ROUNDING_S"},
    "evidence/curves/photons.py": {"TURNS_S"},
    "views/verbs/runs.py": {"FRESH_S", "UNITS_S"},
    "topologies/links/copper_link.py": {"LEAST_DELAY_S"},
    "wire/lldp.py": {"PERIOD_S", "LONGEST_PERIOD_S"},
    "wire/device.py": {"PERIODS_S"},
    "applications/keys/route_messages.py": {"ROUTE_S"},
}


def times(file: Path) -> set[str]:
    """Return the constants of a file that are times, in modules and in classes."""
    found = set()
    for node in nodes(file):
        targets: list[ast.expr] = [node.target] if isinstance(node, ast.AnnAssign) else []
        if isinstance(node, ast.Assign):
            targets = node.targets
        names = [part for each in targets for part in ast.walk(each) if isinstance(part, ast.Name)]
        found |= {name.id for name in names if TIME.fullmatch(name.id)}
    return found


def test_each_process_has_its_waits_in_one_table() -> None:
    for folder in ALL[:-1]:
        for file in sources(folder):
            allowed = NOT_WAITS.get(str(file.relative_to(ROOT)), set())
            assert file.name == "timeouts.py" or times(file) == allowed, file


def test_every_verb_is_a_module_and_verbs_have_no_other() -> None:
    there = {name for name in modules() if re.match(r"\w+\.verbs\.(?!__init__)", name)}
    around = {
        "applications.circuits.verb",
        "applications.netqasm.verb",
        "course.verb",
        "evidence.replay.verb",
        "evidence.verb",
    }
    assert set(MODULES.values()) == there | around


def test_every_row_of_the_conformance_table_names_tests_that_are_there() -> None:
    text = (ROOT / "docs" / "openflow.md").read_text()
    table = text.partition("## Conformance")[2].partition("| section |")[2].partition("\n\n")[0]
    for row in table.splitlines()[2:]:
        *names, file = re.findall(r"`(test_\w+(?:\.py)?)`", row)
        if not file.endswith(".py"):
            names, file = [*names, file], "test_openflow_conformance.py"
        assert names, row
        defined = parsed(ROOT / "tests" / "emulation" / file).body
        assert set(names) <= {each.name for each in defined if isinstance(each, ast.FunctionDef)}


# Names that a stranger smiles at, or that mean something else (docs/glossary.md).
NOT_NAMES = re.compile(
    r"own_noise|require_room|let_go\b|wish|session_?figure|eventfigure|hurr", re.IGNORECASE
)
# "X is no Y", but for "there is no Y".
IS_NO = re.compile(r"(?<![Tt]here )\b(is|are) no (?!more\b|longer\b|sooner\b|earlier\b)")
LUA_TEXT = re.compile(r'"[^"\n]*"')


def test_names_are_plain_words() -> None:
    for folder in ALL[:-1]:
        for file in sources(folder):
            for node in nodes(file):
                name = getattr(node, "name", getattr(node, "attr", getattr(node, "id", None)))
                assert not isinstance(name, str) or not NOT_NAMES.search(name), (file, name)


def texts(file: Path) -> Iterator[str]:
    """Yield the texts in a file that users can meet: not docstrings."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    silent = {
        id(node.body[0].value)
        for node in nodes(file)
        if isinstance(node, documented) and node.body and isinstance(node.body[0], ast.Expr)
    }
    for node in nodes(file):
        if isinstance(node, ast.JoinedStr):
            parts = [part.value if isinstance(part, ast.Constant) else "X" for part in node.values]
            yield "".join(map(str, parts))
        elif isinstance(node, ast.Constant) and id(node) not in silent:
            yield str(node.value)


def test_what_something_is_not_is_said_plainly() -> None:
    for folder in ALL[:-1]:
        for file in sources(folder):
            for text in texts(file):
                assert not IS_NO.search(text), (file, text)
        for file in (ROOT / folder).rglob("*.lua"):
            for text in LUA_TEXT.findall(file.read_text()):
                assert not IS_NO.search(text), (file, text)


PAGES = (*ROOT.glob("*.md"), *ROOT.glob("*/*.md"), *ROOT.glob("labs/*/*.md"))


def test_pages_say_plainly_what_something_is_not() -> None:
    for page in PAGES:
        found = IS_NO.search(" ".join(page.read_text().split()))
        assert found is None, (page, found.string[max(found.start() - 40, 0) : found.end() + 40])


def test_no_file_of_tests_is_longer_than_one_of_the_product() -> None:
    for file in sources("tests"):
        assert len(file.read_text().splitlines()) <= MOST_LINES, file
