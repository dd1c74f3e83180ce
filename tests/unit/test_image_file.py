"""The file of the image: what engines and OCI's layout ask of it, and the same bytes each time."""

import hashlib
import json
import os
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "setup" / "release" / "image_file.py"


def written(folder: Path, name: str) -> Path:
    output = folder / name
    command = [sys.executable, str(PROGRAM), str(folder / "root"), str(output), "0.1.0~dev0"]
    subprocess.run(command, check=True, env={**os.environ, "SOURCE_DATE_EPOCH": "1700000000"})
    return output


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "root"
    (folder / "usr" / "bin").mkdir(parents=True)
    (folder / "usr" / "bin" / "qmn").write_text("#!/bin/sh\n")
    (folder / "usr" / "bin" / "qmn").chmod(0o755)
    (folder / "bin").symlink_to("usr/bin")
    return folder


def test_each_blob_is_named_by_its_digest_and_each_index_leads_to_the_layer(
    root: Path, tmp_path: Path
) -> None:
    with tarfile.open(written(tmp_path, "image.tar")) as tar:
        files = {member.name: tar.extractfile(member).read() for member in tar}  # type: ignore[union-attr]
        for name, content in files.items():
            if name.startswith("blobs/"):
                assert hashlib.sha256(content).hexdigest() == name.rpartition("/")[2]
    (listed,) = json.loads(files["index.json"])["manifests"]
    manifest = json.loads(files["blobs/" + listed["digest"].replace(":", "/")])
    (of_docker,) = json.loads(files["manifest.json"])
    assert of_docker["Config"] == "blobs/" + manifest["config"]["digest"].replace(":", "/")
    (layer,) = manifest["layers"]
    assert of_docker["Layers"] == ["blobs/" + layer["digest"].replace(":", "/")]
    assert of_docker["RepoTags"] == ["qmn:0.1.0-dev0"]  # tags have no ~
    config = json.loads(files[of_docker["Config"]])
    assert config["config"]["Entrypoint"][-1] == "qmn"
    assert config["config"]["Labels"]["org.opencontainers.image.version"] == "0.1.0~dev0"
    (tmp_path / "layer").write_bytes(files[of_docker["Layers"][0]])
    with tarfile.open(tmp_path / "layer") as tar:
        members = {member.name: member for member in tar}
    assert members["usr/bin/qmn"].mode & 0o777 == 0o755
    assert members["bin"].linkname == "usr/bin"


def test_the_same_root_gives_the_same_bytes_however_new_it_is(root: Path, tmp_path: Path) -> None:
    first = written(tmp_path, "first.tar").read_bytes()
    os.utime(root / "usr" / "bin" / "qmn", (1_900_000_000, 1_900_000_000))
    assert written(tmp_path, "second.tar").read_bytes() == first
