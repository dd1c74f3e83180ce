"""Fibres between switches as heard from both ends."""

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import HostPort, Network
from controller_apps.openflow.fibers import ANNOUNCEMENTS_PER_S, FAST_TIMES, LEAST_AT_ONCE, Links
from controller_apps.timeouts import LINK_EXPIRY_S, LINK_FAST_PERIOD_S, LINK_PERIOD_S

ONE, OTHER, THIRD = SwitchPort(1, 3), SwitchPort(2, 4), SwitchPort(3, 5)


def links() -> Links:
    found = Links(Network({1, 2, 3}))
    for at in (ONE, OTHER, THIRD):
        found.port_up(at, 0.0)
    return found


def joined() -> Links:
    found = links()
    assert not found.heard(ONE, OTHER, 0.0)
    assert found.heard(OTHER, ONE, 0.0)
    return found


def test_a_link_is_what_both_ends_have_heard() -> None:
    found = links()
    assert not found.heard(ONE, OTHER, 0.0)
    assert found.network.links == {}
    assert found.heard(OTHER, ONE, 0.1)
    assert found.network.links == {ONE: OTHER, OTHER: ONE}
    assert not found.heard(OTHER, ONE, 0.2)  # no news


def test_a_port_that_hears_two_has_the_last_of_them() -> None:
    found = joined()
    assert not found.heard(THIRD, ONE, 1.0)
    assert found.heard(ONE, THIRD, 1.0)
    assert found.network.links == {ONE: THIRD, THIRD: ONE}


def test_the_port_of_an_announced_host_is_no_link() -> None:
    found = links()
    host = HostPort("mallory", "10.0.0.66", "mallory-q0")
    found.network.attach(ONE, host)
    found.heard(ONE, OTHER, 0.0)
    assert not found.heard(OTHER, ONE, 0.0)
    assert found.network.links == {}
    later = joined()
    later.network.attach(OTHER, host)
    assert later.network.links == {}


def test_ports_that_are_down_say_and_hear_nothing() -> None:
    found = joined()
    found.port_down(ONE)
    assert found.network.links == {}
    assert ONE not in found.due(0.0)
    assert not found.heard(OTHER, ONE, 0.1)
    found.port_up(ONE, 0.2)
    assert not found.heard(ONE, OTHER, 0.3)
    assert found.heard(OTHER, ONE, 0.3)


def test_a_switch_that_leaves_takes_its_links_along() -> None:
    found = joined()
    found.switch_left(2)
    assert found.network.links == {}
    assert found.due(0.0) == [THIRD, ONE]


def test_a_link_is_forgotten_when_one_end_hears_nothing() -> None:
    found = joined()
    found.heard(ONE, OTHER, 5.0)
    assert found.expired(LINK_EXPIRY_S) == []
    assert found.expired(LINK_EXPIRY_S + 0.1) == [ONE]
    assert found.network.links == {}
    assert found.heard(OTHER, ONE, LINK_EXPIRY_S + 0.2)


def test_ports_speak_quickly_at_first() -> None:
    found = Links(Network())
    found.port_up(ONE, 0.0)
    spoken = [step for step in range(100) if found.due(step * LINK_FAST_PERIOD_S / 2)]
    assert spoken[:FAST_TIMES] == list(range(0, 2 * FAST_TIMES, 2))
    assert spoken[FAST_TIMES] - spoken[FAST_TIMES - 1] == 2 * LINK_PERIOD_S / LINK_FAST_PERIOD_S


def test_a_port_that_has_heard_somebody_speaks_seldom() -> None:
    found = joined()
    assert found.due(0.0) == [THIRD, ONE, OTHER]
    spoken = [found.due(LINK_FAST_PERIOD_S * step) for step in range(1, FAST_TIMES)]
    assert spoken == [[THIRD]] * (FAST_TIMES - 1)
    assert found.due(LINK_PERIOD_S) == [ONE, OTHER]


def test_who_hears_a_port_that_has_not_heard_it_answers() -> None:
    found = Links(Network({1, 2}))
    found.port_up(ONE, 0.0)
    found.due(0.0)
    found.port_up(OTHER, 60.0)
    found.heard(OTHER, ONE, 60.0)
    assert found.answers(ONE, OTHER, 60.0)
    assert not found.answers(ONE, OTHER, 60.1)  # that is on its way
    assert found.heard(ONE, OTHER, 60.2)
    assert not found.answers(OTHER, ONE, 60.2)
    assert not found.answers(ONE, OTHER, 70.0)  # who has heard it


def test_ports_of_a_large_network_speak_a_few_at_a_time_and_seldom() -> None:
    ports = [SwitchPort(switch, port) for switch in range(256) for port in range(10)]
    found = Links(Network(set(range(256))))
    for one, other in zip(ports[::2], ports[1::2], strict=True):
        for at in (one, other):
            found.port_up(at, 0.0)
        found.heard(one, other, 0.0)
        found.heard(other, one, 0.0)
    times = dict.fromkeys(ports, 0)
    steps = [found.due(0.2 * step) for step in range(1, 5 * 120)]
    for at in (at for speaking in steps for at in speaking):
        times[at] += 1
    most = LEAST_AT_ONCE + 0.2 * ANNOUNCEMENTS_PER_S
    assert max(map(len, steps)) <= most
    # The number of periods in two minutes, the first of which ends whenever it is a port's turn.
    periods = 120 / (len(ports) / ANNOUNCEMENTS_PER_S)
    assert set(times.values()) <= {int(periods), int(periods) + 1}


def test_a_link_of_a_large_network_may_be_silent_for_longer() -> None:
    found = joined()
    for port in range(10, 1010):
        found.port_up(SwitchPort(3, port), 0.0)
    longer = 1003 / (ANNOUNCEMENTS_PER_S * LINK_PERIOD_S)
    assert found.expired(LINK_EXPIRY_S * longer - 0.1) == []
    assert set(found.expired(LINK_EXPIRY_S * longer + 0.1)) <= {ONE, OTHER}
    assert found.network.links == {}


def with_hosts(found: Links, count: int) -> list[SwitchPort]:
    """Return ports that have been up for a while, at each of which a host has announced itself."""
    ports = [SwitchPort(3, port) for port in range(10, 10 + count)]
    for at in ports:
        found.port_up(at, 0.0)
        host_port = HostPort(f"h{at.port}", f"10.0.{at.port >> 8}.{at.port & 255}", "q0", None)
        assert found.network.attach(at, host_port)
    return ports


def test_a_port_at_which_a_host_is_says_nothing_until_it_is_gone() -> None:
    """So what hosts cost does not grow with their number: two ends of one fibre speak here."""
    found = joined()
    ports = with_hosts(found, 200)
    steps = [found.due(LINK_PERIOD_S * step) for step in range(60)]
    spoken = [at for speaking in steps for at in speaking]
    assert set(spoken) == {ONE, OTHER, THIRD}
    assert spoken.count(ONE) == spoken.count(OTHER) == len(steps)
    found.network.detach(ports[0])
    assert ports[0] in found.due(LINK_PERIOD_S * 60)


def test_a_silent_link_is_noticed_as_soon_beside_many_hosts() -> None:
    found = joined()
    with_hosts(found, 1000)
    assert found.expired(LINK_EXPIRY_S - 0.1) == []
    assert set(found.expired(LINK_EXPIRY_S + 0.1)) <= {ONE, OTHER}
    assert found.network.links == {}


def test_a_link_lasts_as_long_as_ports_were_to_be_silent_when_hosts_come_late() -> None:
    """A port that has to wait for longer than a small network's may do so."""
    found = joined()
    ports = [SwitchPort(3, port) for port in range(10, 1010)]
    for at in ports:
        found.port_up(at, 0.0)
    found.due(1.0)
    found.heard(ONE, OTHER, 1.0)
    found.heard(OTHER, ONE, 1.0)
    with_hosts(found, len(ports))
    longer = (len(ports) + 3) / (ANNOUNCEMENTS_PER_S * LINK_PERIOD_S)
    assert found.expired(1.0 + LINK_EXPIRY_S * longer - 0.1) == []
    assert set(found.expired(1.0 + LINK_EXPIRY_S * longer + 0.1)) <= {ONE, OTHER}
    assert found.network.links == {}
