"""Releases: the refusal of a wrong tag, and the bill of materials of an image."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
RELEASE = ROOT / "setup" / "release"


def bill(root: Path, output: Path) -> Any:
    command = [sys.executable, str(RELEASE / "sbom.py"), str(root), str(output), "0.1.0"]
    subprocess.run(command, check=True, env={**os.environ, "SOURCE_DATE_EPOCH": "1700000000"})
    return json.loads(output.read_text())


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Return a root with this machine's Debian packages, and one Python package."""
    folder = tmp_path / "root"
    (folder / "var" / "lib").mkdir(parents=True)
    (folder / "var" / "lib" / "dpkg").symlink_to("/var/lib/dpkg")
    metadata = distribution("prometheus_client").read_text("METADATA")
    place = folder / "opt/qmn/.venv/lib/python3.11/site-packages/prometheus_client-1.dist-info"
    place.mkdir(parents=True)
    (place / "METADATA").write_text(str(metadata))
    return folder


def test_the_bill_of_materials_has_what_dpkg_and_pip_have_installed(
    root: Path, tmp_path: Path
) -> None:
    """dpkg-query lists the same packages."""
    packages = bill(root, tmp_path / "bill.json")["packages"]
    urls = {each["externalRefs"][0]["referenceLocator"] for each in packages}
    version = distribution("prometheus_client").version
    assert f"pkg:pypi/prometheus-client@{version}" in urls
    shown = "${db:Status-Status} ${Package} ${Version}\n"
    lines = subprocess.check_output(["dpkg-query", "-W", "-f", shown], text=True).splitlines()
    installed = {tuple(line.split()[1:]) for line in lines if line.startswith("installed ")}
    of_debian = {
        (each["name"], each["versionInfo"])
        for each in packages
        if "pkg:deb/" in each["externalRefs"][0]["referenceLocator"]
    }
    assert of_debian == installed
    assert len(packages) == len({each["SPDXID"] for each in packages}) == len(urls)


def test_a_bill_of_materials_has_what_spdx_demands_and_is_the_same_again(
    root: Path, tmp_path: Path
) -> None:
    """Fields of SPDX 2.3, clauses 6 and 7; a package URL quotes + and : of versions."""
    made = bill(root, tmp_path / "bill.json")
    assert made["spdxVersion"] == "SPDX-2.3"
    assert made["dataLicense"] == "CC0-1.0"
    assert made["SPDXID"] == "SPDXRef-DOCUMENT"
    assert made["creationInfo"]["created"] == "2023-11-14T22:13:20Z"
    assert re.fullmatch(r"https://\S+-[0-9a-f]{64}", made["documentNamespace"])
    for each in made["packages"]:
        assert re.fullmatch(r"SPDXRef-[\w.-]+", each["SPDXID"])
        assert each["downloadLocation"] == "NOASSERTION"
        url = each["externalRefs"][0]["referenceLocator"]
        assert re.fullmatch(r"pkg:(deb/debian|pypi)/[\w.%-]+@[\w.%~-]+(\?arch=\w+)?", url)
    assert bill(root, tmp_path / "again.json") == made


def tagged(folder: Path, tag: str) -> str:
    """Return the first words of a build of version 0.1.0 whose commit has a tag."""
    (folder / "setup" / "release").mkdir(parents=True)
    shutil.copy(RELEASE / "build", folder / "setup" / "release")
    (folder / "pyproject.toml").write_text('[project]\nversion = "0.1.0"\n')
    who = ["-c", "user.name=qmn", "-c", "user.email=qmn"]
    for words in (
        ["init", "--quiet"],
        ["add", "."],
        ["commit", "--quiet", "-m", "all"],
        ["tag", tag],
    ):
        subprocess.run(["git", *who, *words], cwd=folder, check=True)
    command = [folder / "setup" / "release" / "build"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0  # there is nothing to build
    return done.stdout + done.stderr


def test_a_tag_of_another_version_is_refused(tmp_path: Path) -> None:
    refusal = "this commit has the tag v0.2.0, and pyproject.toml the version 0.1.0"
    assert refusal in tagged(tmp_path / "other", "v0.2.0")
    right = tagged(tmp_path / "right", "v0.1.0")
    assert "sdist and wheel" in right
    assert "the tag" not in right


def test_the_changelog_begins_with_the_version_and_if_released_its_date() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    released = yaml.safe_load((ROOT / "CITATION.cff").read_text()).get("date-released")
    heading = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[0]
    assert heading == (f"{version} ({released})" if released else version.removesuffix(".dev0"))
    assert version.endswith(".dev0") == (released is None)


def test_a_tag_pushes_the_image_that_make_release_builds() -> None:
    text = (ROOT / ".github" / "workflows" / "release.yml").read_text()
    workflow = yaml.safe_load(text)
    assert workflow[True]["push"] == {"tags": ["v*"]}  # YAML 1.1 reads `on` so
    assert workflow["permissions"]["packages"] == "write"
    runs = [step.get("run", "") for step in workflow["jobs"]["release"]["steps"]]
    assert runs.index("make release") < next(
        n for n, run in enumerate(runs) if "skopeo" in run and "ghcr.io" in run
    )
    assert ".image.tar" in (RELEASE / "build").read_text()
