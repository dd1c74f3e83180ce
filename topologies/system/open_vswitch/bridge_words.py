"""The words by which ovs-vsctl makes a bridge with its ports.

`add-port` and `set Interface NAME` look a name up among all ports there are, also those of the same
transaction, and `add-br` has all of them read again: time with the square of the ports. Rows that
are made by `create`, and name each other, take none of that.
"""

from collections.abc import Mapping, Sequence


def bridge_words(
    name: str, options: Sequence[str], interfaces: Mapping[str, Sequence[str]]
) -> list[str]:
    """Return the words for a bridge, in place of an existing one of that name.

    Options are columns, as "fail_mode=secure"; interfaces are the columns of each, by its name.
    """
    words = ["--if-exists", "del-br", name]
    ports = []
    for number, (each, columns) in enumerate({name: ["type=internal"], **interfaces}.items()):
        interface, port = f"@{name}i{number}", f"@{name}p{number}"
        words += ["--", f"--id={interface}", "create", "Interface", _named(each), *columns]
        words += ["--", f"--id={port}", "create", "Port", _named(each), f"interfaces={interface}"]
        ports.append(port)
    bridge = f"@{name}b"
    words += ["--", f"--id={bridge}", "create", "Bridge", _named(name)]
    words += [f"ports=[{','.join(ports)}]", *options]
    return [*words, "--", "add", "Open_vSwitch", ".", "bridges", bridge]


def _named(name: str) -> str:
    return f'name="{name}"'
