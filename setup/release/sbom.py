"""Writes the bill of materials of an image (SPDX 2.3): its packages of Debian and of Python.

python setup/release/sbom.py ROOT OUTPUT VERSION
"""

import hashlib
import json
import os
import re
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from email.parser import Parser
from importlib.metadata import distributions
from pathlib import Path
from urllib.parse import quote

Found = tuple[str, str, str]  # name, version, package URL


def of_debian(root: Path) -> Iterator[Found]:
    for paragraph in (root / "var/lib/dpkg/status").read_text().split("\n\n"):
        fields = Parser().parsestr(paragraph)
        if fields.get("Status", "").endswith(" installed"):
            name, version = fields["Package"], fields["Version"]
            url = f"pkg:deb/debian/{quote(name)}@{quote(version)}?arch={fields['Architecture']}"
            yield name, version, url


def of_python(root: Path) -> Iterator[Found]:
    places = [str(each) for each in root.glob("opt/qmn/.venv/lib/python3*/site-packages")]
    for each in distributions(path=places):
        name = re.sub(r"[-_.]+", "-", each.name).lower()
        yield name, each.version, f"pkg:pypi/{name}@{quote(each.version)}"


def document(found: list[Found], version: str, created: datetime) -> dict[str, object]:
    digest = hashlib.sha256(json.dumps(found).encode()).hexdigest()
    packages = [
        {
            "SPDXID": f"SPDXRef-{number}",
            "name": name,
            "versionInfo": of,
            "downloadLocation": "NOASSERTION",
            "filesAnalyzed": False,
            "externalRefs": [
                {
                    "referenceCategory": "PACKAGE-MANAGER",
                    "referenceType": "purl",
                    "referenceLocator": url,
                }
            ],
        }
        for number, (name, of, url) in enumerate(found)
    ]
    return {
        "spdxVersion": "SPDX-2.3",
        "dataLicense": "CC0-1.0",
        "SPDXID": "SPDXRef-DOCUMENT",
        "name": f"qmn-{version}",
        "documentNamespace": f"https://spdx.org/spdxdocs/qmn-{version}-{digest}",
        "creationInfo": {
            "created": f"{created:%Y-%m-%dT%H:%M:%SZ}",
            "creators": ["Tool: qmn-make-release"],
        },
        "documentDescribes": [each["SPDXID"] for each in packages],
        "packages": packages,
    }


if __name__ == "__main__":
    root = Path(sys.argv[1])
    found = sorted({*of_debian(root), *of_python(root)})
    created = datetime.fromtimestamp(int(os.environ["SOURCE_DATE_EPOCH"]), UTC)
    text = json.dumps(document(found, sys.argv[3], created), indent=1)
    Path(sys.argv[2]).write_text(f"{text}\n")
