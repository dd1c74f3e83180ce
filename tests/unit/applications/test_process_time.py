"""The clock of a program that people have written, in stepped time."""

import time

from stepping import SINCE_NS, stepping

from applications.netqasm.process_time import counting


def test_pauses_of_python_itself_are_the_networks_while_a_program_counts_its_time() -> None:
    before_s = time.monotonic()
    with stepping() as gate, counting(gate.time):
        time.sleep(3_600)
        assert time.monotonic() == 3_600
        assert time.time() == (SINCE_NS + 3_600 * 10**9) / 1e9
    assert time.monotonic() - before_s < 60
