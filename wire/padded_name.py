"""Names in fields of a fixed size: ASCII, filled up with zero bytes."""

from wire.malformed import MalformedPacket


def padded_name(padded: bytes) -> str:
    """Return the name in a field; raise MalformedPacket for anything else."""
    try:
        name = padded.rstrip(b"\0").decode("ascii")
    except UnicodeDecodeError as error:
        raise MalformedPacket(f"name {padded!r} is not ASCII") from error
    if not name or not name.isprintable():
        raise MalformedPacket(f"name {padded!r} is not a name")
    return name
