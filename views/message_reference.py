"""The page of all messages: set-up messages, telemetry, optical OpenFlow, gRPC.

python -m views.message_reference > messages.md; `make site` has it as a page.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, fields

from topologies.system.processes.programs import ROOT
from views.comments import MESSAGES, by_name, meaning
from views.dissection.layout import Layout, device_layouts, metadata_layouts
from views.reference import table
from wire import device, optical
from wire.metadata import header
from wire.metadata.decoding import KINDS
from wire.parameters.option import unit_of

INTRODUCTION = """# All messages

    tshark -X lua_script:runs/latest/qmn.lua -r runs/latest/all.pcapng -Y qmeta

This page is made from the declarations of the formats. Each begins with its version; another
version is refused."""
FIELDS = ("field", "bytes", "unit", "meaning")
OPTICAL = (optical.PortOptics, optical.PortTuning, optical.PortLight)
Row = tuple[str, ...]
COMMENT = re.compile(r"^\s*//\s?(.*)$")
STARTS = re.compile(r"^\s*(message|service|enum|oneof)\s+(\w+)")
FIELD = re.compile(
    r"^\s*(?:(?:repeated |optional )?([\w.]+|map<[^>]+>)\s+)?(\w+)\s*=\s*\d+[^;]*;\s*(?://\s*(.*))?$"
)
CALL = re.compile(r"^\s*rpc (\w+)\((.*?)\) returns \((.*?)\)")


def page() -> str:
    parts = [INTRODUCTION, f"## Quantum metadata (TCP port {header.METADATA_PORT})"]
    parts += [f"Version {header.VERSION}. Header: magic, version, kind, length, session."]
    parts += messages(metadata_layouts(), KINDS)
    parts += [
        f"## Devices (UDP port {device.DEVICE_PORT})",
        f"Version {header.VERSION}, in datagrams.",
    ]
    parts += messages(device_layouts(), device.kinds())
    parts += ["## Optical properties of OpenFlow 1.4", *properties()]
    for name in ("dispatcher", "sabot", "record"):
        parts += [
            f"## gRPC: wire/{name}.proto",
            *proto((ROOT / "wire" / f"{name}.proto").read_text()),
        ]
    return "\n\n".join(part for part in parts if part) + "\n"


def messages(layouts: list[Layout], kinds: dict[int, type]) -> Iterator[str]:
    """Yield a section for each kind of message, with the bytes and meaning of each field."""
    for layout in layouts:
        kind = kinds[layout.number]
        sizes = {each.name: f"{each.size}" for each in layout.fields}
        rows = [
            (f"`{name}`", sizes.get(name, "rest"), unit_of(name), meaning(kind, name, MESSAGES))
            for name in [each.name for each in fields(kind)]
            if name != "session"
        ]
        yield f"### {layout.name} (kind {layout.number})"
        yield " ".join((kind.__doc__ or "").split())
        yield table(FIELDS, rows) if rows else ""


def properties() -> Iterator[str]:
    for kind in OPTICAL:
        yield f"### {kind.__name__}\n\n{' '.join((kind.__doc__ or '').split())}"
        rows = [
            (f"`{each.name}`", unit_of(each.name), meaning(kind, each.name, MESSAGES))
            for each in fields(kind)
        ]
        yield table(("field", "unit", "meaning"), rows)


def proto(text: str) -> Iterator[str]:
    """Yield what a .proto file declares: calls, messages and enums, with their comments."""
    for name, section in sections(text).items():
        yield f"### {name}"
        yield section.text
        yield table(("name", "type", "meaning"), section.rows) if section.rows else ""


@dataclass
class Section:
    """A message, an enum or a service of a .proto file."""

    text: str
    rows: list[Row] = field(default_factory=list)


def sections(text: str) -> dict[str, Section]:
    named_sections: dict[str, Section] = {}
    owners: list[str] = []
    comments: list[str] = []
    for line in text.splitlines():
        if comment := COMMENT.match(line):
            comments.append(comment[1])
            continue
        words = " ".join(comments)
        if start := STARTS.match(line):
            if start[1] != "oneof":
                owners.append(start[2])
                named_sections[".".join(owners)] = Section(words)
            else:
                owners.append(owners[-1])  # its fields are those of the message
        elif row := row_of(line, words):
            named_sections[".".join(dict.fromkeys(owners))].rows.append(row)
        if line.rstrip().endswith("}"):
            owners.pop()
        comments = []
    return named_sections


def row_of(line: str, words: str) -> Row | None:
    """Return name, type and meaning of a call, a field or a value; None for another line."""
    if match := CALL.match(line):
        return f"`{match[1]}`", f"{match[2]} → {match[3]}", words or by_name(match[1].lower())
    if match := FIELD.match(line):
        name, kind = match[2], match[1] or ""
        behind = " ".join(filter(None, [words, match[3]]))
        return f"`{name}`", kind, behind or by_name(name.lower())
    return None


if __name__ == "__main__":
    print(page(), end="")
