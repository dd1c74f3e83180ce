"""Writes an image as a file: one layer, its configuration, and both indexes that engines read.

python setup/release/image_file.py ROOT OUTPUT VERSION

The layout is that of OCI (image-spec, image-layout.md); the manifest.json is of `docker save`.
"""

import gzip
import hashlib
import io
import json
import os
import sys
import tarfile
from pathlib import Path
from typing import Any

EPOCH = int(os.environ["SOURCE_DATE_EPOCH"])
# Settings of a container's own network, and limits of its own users, are opened for writing; then
# the command is qmn.
ENTRY = """for own in net user; do
    mount --bind /proc/sys/$own /proc/sys/$own 2>/dev/null &&
        mount -o remount,bind,rw /proc/sys/$own 2>/dev/null || true
done
exec qmn "$@"
"""
TITLE = "org.opencontainers.image"
MEDIA = "application/vnd.oci.image"


def layer_of(root: Path) -> bytes:
    """Return the files of a root as a tar, in order of their names and as old as the commit."""
    output = io.BytesIO()
    with tarfile.open(fileobj=output, mode="w", format=tarfile.PAX_FORMAT) as tar:
        for path in sorted(root.rglob("*"), key=lambda each: each.relative_to(root).parts):
            member = tar.gettarinfo(path, str(path.relative_to(root)))
            if member is None:  # a socket
                continue
            member.uname = member.gname = ""
            member.mtime = min(int(member.mtime), EPOCH)
            if member.isreg():
                with path.open("rb") as file:
                    tar.addfile(member, file)
            else:
                tar.addfile(member)
    return output.getvalue()


def configuration(layer: bytes, version: str) -> dict[str, Any]:
    made = {
        f"{TITLE}.title": "qmn",
        f"{TITLE}.description": "The Mininet for programmable quantum networks",
        f"{TITLE}.version": version,
        f"{TITLE}.licenses": "BSD-3-Clause",
        f"{TITLE}.base.name": "debian:bookworm",
    }
    return {
        "architecture": {"x86_64": "amd64", "aarch64": "arm64"}[os.uname().machine],
        "os": "linux",
        "created": "1970-01-01T00:00:00Z",
        "config": {
            "Env": ["PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"],
            "Entrypoint": ["/bin/sh", "-c", ENTRY, "qmn"],
            "Cmd": ["--help"],
            "WorkingDir": "/root",
            "Labels": made,
        },
        "rootfs": {"type": "layers", "diff_ids": [f"sha256:{hashlib.sha256(layer).hexdigest()}"]},
        "history": [{"created": "1970-01-01T00:00:00Z", "created_by": "make release"}],
    }


class ImageFile:
    """The tar of an image, to which blobs are added by their digest."""

    def __init__(self, tar: tarfile.TarFile) -> None:
        self._tar = tar

    def add(self, name: str, content: bytes) -> None:
        member = tarfile.TarInfo(name)
        member.size, member.mtime, member.mode = len(content), EPOCH, 0o644
        self._tar.addfile(member, io.BytesIO(content))

    def blob(self, content: bytes, media: str) -> dict[str, Any]:
        """Add a blob; return its descriptor."""
        digest = hashlib.sha256(content).hexdigest()
        self.add(f"blobs/sha256/{digest}", content)
        return {"mediaType": media, "digest": f"sha256:{digest}", "size": len(content)}


def write(root: Path, output: Path, version: str) -> None:
    tag = version.replace("~", "-")  # which tags cannot have
    layer = layer_of(root)
    with tarfile.open(output, "w", format=tarfile.PAX_FORMAT) as tar:
        image = ImageFile(tar)
        packed = image.blob(gzip.compress(layer, 6, mtime=0), f"{MEDIA}.layer.v1.tar+gzip")
        config = image.blob(
            json.dumps(configuration(layer, version)).encode(), f"{MEDIA}.config.v1+json"
        )
        manifest = {
            "schemaVersion": 2,
            "mediaType": f"{MEDIA}.manifest.v1+json",
            "config": config,
            "layers": [packed],
        }
        listed = image.blob(json.dumps(manifest).encode(), manifest["mediaType"])
        listed["annotations"] = {f"{TITLE}.ref.name": tag, "io.containerd.image.name": f"qmn:{tag}"}
        image.add("oci-layout", b'{"imageLayoutVersion": "1.0.0"}')
        image.add("index.json", json.dumps({"schemaVersion": 2, "manifests": [listed]}).encode())
        of_docker = {
            "Config": path_of(config),
            "RepoTags": [f"qmn:{tag}"],
            "Layers": [path_of(packed)],
        }
        image.add("manifest.json", json.dumps([of_docker]).encode())


def path_of(descriptor: dict[str, Any]) -> str:
    return "blobs/" + str(descriptor["digest"]).replace(":", "/")


if __name__ == "__main__":
    write(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
