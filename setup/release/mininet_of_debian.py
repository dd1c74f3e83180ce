"""Mininet, which is not on PyPI: Debian's package is found without its other Python packages."""

__path__ = ["/usr/lib/python3/dist-packages/mininet"]
