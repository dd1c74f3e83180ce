"""The error of every format: bytes that are not what they claim to be."""


class MalformedPacket(ValueError):
    """The other side sent bytes that are not what they claim to be."""
