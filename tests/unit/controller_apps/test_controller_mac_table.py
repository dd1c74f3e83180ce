"""The memory of the learning switch."""

from controller_apps.openflow.mac_table import MAX_STATIONS, MacTable

STATION = bytes.fromhex("020000000001")


def test_a_station_is_where_it_was_last_seen() -> None:
    table = MacTable()
    assert table.port_of(1, STATION) is None
    assert not table.learn(1, STATION, 3)
    assert not table.learn(1, STATION, 3)
    assert table.learn(1, STATION, 4)
    assert table.port_of(1, STATION) == 4
    assert table.port_of(2, STATION) is None
    table.forget(1)
    assert table.port_of(1, STATION) is None


def test_group_addresses_are_never_learned() -> None:
    table = MacTable()
    table.learn(1, b"\xff" * 6, 3)
    assert table.port_of(1, b"\xff" * 6) is None


def test_the_table_is_bounded() -> None:
    table = MacTable()
    for number in range(MAX_STATIONS + 100):
        table.learn(1, b"\x02" + number.to_bytes(5, "big"), 3)
    assert len(table.ports[1]) == MAX_STATIONS
    assert table.learn(1, b"\x02" + bytes(5), 4)  # what is known still moves
