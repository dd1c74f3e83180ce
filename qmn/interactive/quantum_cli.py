"""The quantum verbs of `qmn cli`: `alice qsend bob hello` beside Mininet's `alice ping bob`."""

from qmn.interactive import cli_tables
from qmn.interactive.network_cli import NetworkCLI, arguments_of
from qmn.jobs.transfer import TransferError
from qmn.options import BadInput
from qmn.running import light_paths
from qmn.running.controller_console import wide_console
from wire.parameters.checks import range_words

MOST_ROUNDS = 10_000
MOST_SECONDS = 3_600.0


class QuantumCLI(NetworkCLI):
    def do_qsend(self, line: str) -> None:
        """Send a text over light.
        Usage: qsend alice bob hello
           or: alice qsend bob hello"""
        sender, receiver, text, *_ = [*line.split(None, 2), "", "", ""]
        if not text:
            raise BadInput("usage: qsend SENDER RECEIVER TEXT")
        print(cli_tables.sent(receiver, self.network.send(sender, receiver, text.encode())))

    def do_qping(self, line: str) -> None:
        """Send rounds of a few pairs: what arrives, what is wrong, how long light paths take.
        Usage: qping alice bob [rounds]"""
        sender, receiver, rounds = arguments_of(line, "qping SENDER RECEIVER [ROUNDS]", 3, "4")
        count = int(_number(rounds, "rounds", 1, MOST_ROUNDS))
        done, tried = [], 0
        try:
            for used in self.network.ping(sender, receiver, count):
                done.append(used)
                tried += 1
                print(cli_tables.ping_line(tried, receiver, used), flush=True)
        except TransferError:
            tried += 1
            raise
        finally:
            if tried:
                print(cli_tables.ping_summary(receiver, done, tried))

    def do_qiperf(self, line: str) -> None:
        """Send as fast as it goes: pairs/s and bit/s.
        Usage: qiperf alice bob [seconds]"""
        sender, receiver, arguments = arguments_of(line, "qiperf SENDER RECEIVER [SECONDS]", 3, "3")
        seconds = _number(arguments, "seconds", 0.1, MOST_SECONDS)
        used = self.network.iperf(sender, receiver, seconds)
        print(cli_tables.rate(sender, receiver, used))

    def do_qpaths(self, line: str) -> None:
        """Show light paths that stand, sessions and fibres, as `qmn paths`.
        Usage: qpaths"""
        arguments_of(line, "qpaths", 0)
        light_paths.ask_and_show(as_json=False)

    def do_qlinks(self, line: str) -> None:
        """Show every fibre: what it loses now, and the photons its switches have counted.
        Usage: qlinks"""
        arguments_of(line, "qlinks", 0)
        wide_console().print(cli_tables.fibers_table(self.network.fibers()))

    def do_qstate(self, line: str) -> None:
        """Show the device of a host, and the blocks of qubits that it holds.
        Usage: qstate alice"""
        (host,) = arguments_of(line, "qstate HOST", 1)
        for table in cli_tables.state(self.network.state(host)):
            wide_console().print(table)

    def do_qtrace(self, line: str) -> None:
        """Show the light paths of a session, with the loss and the rotation of every hop.
        Usage: qtrace alice bob"""
        sender, receiver = arguments_of(line, "qtrace SENDER RECEIVER", 2)
        for path in self.network.trace(sender, receiver):
            wide_console().print(cli_tables.trace(path))


QuantumCLI.host_verbs = sorted(name[3:] for name in vars(QuantumCLI) if name.startswith("do_"))


def _number(text: str, what: str, least: float, most: float) -> float:
    """Return a number in its range; raise BadInput for any other."""
    try:
        number = float(text)
    except ValueError as error:
        choices = range_words(least, most)
        raise BadInput(f"{what} {text!r} is not a number: choose {choices}") from error
    if not least <= number <= most:
        raise BadInput(f"{what} {text}: choose {range_words(least, most)}")
    return number
