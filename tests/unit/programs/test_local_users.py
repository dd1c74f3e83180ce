"""The users of this machine behind connections by the loopback."""

from pathlib import Path

from programs.local_users import NOBODY, owner_of


def test_the_kernels_table_is_read_by_local_address() -> None:
    # proc(5), from a machine with 127.0.0.1:16653 of user 1000 and 10.0.0.2:5201 of user 33.
    table = (
        "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid\n"
        "   0: 0100007F:410D 0100007F:19FD 01 00000000:00000000 00:00000000 00000000  1000 0 1 1\n"
        "   1: 0200000A:1451 00000000:0000 0A 00000000:00000000 00:00000000 00000000    33 0 2 1\n"
    )
    assert owner_of("127.0.0.1", 16653, table) == 1000
    assert owner_of("10.0.0.2", 5201, table) == 33
    assert owner_of("127.0.0.1", 6653, table) == NOBODY
    assert Path("/proc/net/tcp").read_text().split()[:3] == table.split()[:3]
