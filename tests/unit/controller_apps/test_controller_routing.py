"""Light paths by loss, loss budget, wavelength and rotation."""

import pytest
from metadata_scene import rotating

from controller_apps.light.optics import Optics, SwitchOptics, SwitchPort
from controller_apps.light.paths import Direction, Hop, Network, directions, switches
from controller_apps.light.routing import (
    Leg,
    LightPath,
    Limits,
    cheapest_path,
    rotation_of,
    route,
    why_not,
)
from wire.metadata.vocabulary import Reason
from wire.optical import ALL_VALID, ANY_PORT, TUNABLE, PathOptics, PortLight, PortOptics

CHANNEL_MHZ, OTHER_MHZ = 193_400_000, 193_500_000
START, END = SwitchPort(1, 1), SwitchPort(3, 1)
BY_TWO = (Hop(1, 1, 12), Hop(2, 21, 23), Hop(3, 32, 1))
BY_FOUR = (Hop(1, 1, 14), Hop(4, 41, 43), Hop(3, 34, 1))


def ring() -> Network:
    """Return 1-2-3-4-1; port 12 of switch 1 leads to port 21 of switch 2, and so on."""
    network = Network({1, 2, 3, 4})
    for one, other in ((1, 2), (2, 3), (3, 4), (4, 1)):
        network.add_link(SwitchPort(one, 10 * one + other), SwitchPort(other, 10 * other + one))
    return network


def light(tx_power: int = 0, rx_power: int = 0) -> PortLight:
    return PortLight(ALL_VALID, CHANNEL_MHZ, 0, 0, CHANNEL_MHZ, 0, 0, tx_power, rx_power, 0, 250)


def band(least_mhz: int, most_mhz: int) -> PortOptics:
    return PortOptics(TUNABLE, least_mhz, most_mhz, 50_000, least_mhz, most_mhz, 50_000, -200, 0)


def path(network: Network, **limits: int) -> LightPath | None:
    return cheapest_path(network, Leg(START, END), Limits(**limits))  # type: ignore[arg-type]


def hops(found: LightPath | None) -> tuple[Hop, ...]:
    assert found is not None
    return found.hops


def test_of_two_ways_the_one_of_less_insertion_loss_is_taken() -> None:
    network = ring()
    network.optics.switches = {2: rotating(0, 700), 4: rotating(0, 600)}
    found = path(network)
    assert hops(found) == BY_FOUR
    assert found == LightPath(BY_FOUR, 600, 0)
    network.optics.take(4, rotating(0, 701))
    assert hops(path(network)) == BY_TWO


def test_a_longer_way_of_less_loss_is_taken() -> None:
    network = ring()
    network.add_link(SwitchPort(1, 13), SwitchPort(3, 31))
    assert hops(path(network)) == (Hop(1, 1, 13), Hop(3, 31, 1))
    network.optics.measured(SwitchPort(1, 13), light())
    network.optics.measured(SwitchPort(3, 31), light(rx_power=-25))
    assert hops(path(network)) == BY_TWO


def test_the_loss_of_fibres_is_the_far_ends_power_less_the_near_ends() -> None:
    network = ring()
    network.optics.lights = {
        START: light(rx_power=-3),  # the host launches 0 dBm
        SwitchPort(1, 12): light(tx_power=10),
        SwitchPort(2, 21): light(rx_power=4),
        END: light(rx_power=-12),  # measured from the host, alike towards it
        SwitchPort(1, 14): light(tx_power=10),
        SwitchPort(4, 41): light(rx_power=3),
    }
    found = path(network)
    assert found == LightPath(BY_TWO, 300 + 600 + 1200, 0)


def test_a_gain_counts_as_no_loss() -> None:
    network = ring()
    network.optics.lights = {START: light(rx_power=5)}
    found = path(network)
    assert found is not None
    assert found.loss_mdb == 0


def test_single_paths_of_a_switch_may_differ() -> None:
    network = ring()
    worse = PathOptics(21, 23, 2000, 0)
    network.optics.switches[2] = SwitchOptics.reported(
        [PathOptics(ANY_PORT, ANY_PORT, 0, 0), worse]
    )
    assert hops(path(network)) == BY_FOUR


def test_a_stuck_path_is_used_and_stands_in_the_way_of_others() -> None:
    network = ring()
    network.optics.take(2, SwitchOptics.reported([PathOptics(21, 23, 0, 0, stuck=True)]))
    assert hops(path(network)) == BY_TWO
    for stuck in (PathOptics(21, 5, 0, 0, stuck=True), PathOptics(5, 23, 0, 0, stuck=True)):
        network.optics.take(2, SwitchOptics.reported([stuck]))
        assert hops(path(network)) == BY_FOUR


def test_the_loss_budget_is_kept_to_the_last_thousandth() -> None:
    network = ring()
    network.optics.switches = {number: rotating(0, 1000) for number in (1, 2, 3, 4)}
    assert hops(path(network, loss_budget_mdb=3000)) == BY_TWO
    assert path(network, loss_budget_mdb=2999) is None


def test_every_port_on_the_way_must_be_tunable_to_the_wavelength() -> None:
    network = ring()
    network.optics.described(SwitchPort(2, 23), band(OTHER_MHZ, OTHER_MHZ))
    assert hops(path(network, frequency_mhz=CHANNEL_MHZ)) == BY_FOUR
    assert hops(path(network, frequency_mhz=OTHER_MHZ)) == BY_TWO
    network.optics.described(END, band(OTHER_MHZ, OTHER_MHZ))
    assert path(network, frequency_mhz=CHANNEL_MHZ) is None


def test_a_frequency_must_lie_on_the_grid_of_every_port() -> None:
    network = ring()
    network.optics.described(END, band(CHANNEL_MHZ - 100_000, CHANNEL_MHZ + 100_000))
    for offset_mhz, fits in ((0, True), (50_000, True), (12_500, False), (150_000, False)):
        found = path(network, frequency_mhz=CHANNEL_MHZ + offset_mhz)
        assert (found is not None) == fits


def test_a_rotation_can_be_asked_for() -> None:
    network = ring()
    network.optics.switches = {1: rotating(1), 2: rotating(2), 3: rotating(2), 4: rotating(3)}
    found = path(network)
    assert found is not None
    assert (found.hops, found.rotation) == (BY_TWO, 1 ^ 2 ^ 2)
    assert hops(path(network, rotation=1)) == BY_TWO
    assert hops(path(network, rotation=1 ^ 3 ^ 2)) == BY_FOUR
    assert path(network, rotation=2) is None


def test_rotations_of_several_paths_add_up() -> None:
    paths = [LightPath((), 0, rotation) for rotation in (1, 2, 2)]
    assert rotation_of(paths) == 1
    assert rotation_of([]) == 0


def test_the_legs_of_a_route_share_nothing() -> None:
    network = ring()
    legs = [Leg(START, END), Leg(SwitchPort(1, 2), SwitchPort(3, 2))]
    found = route(network, legs, Limits())
    assert found is not None
    assert [switches(path.hops) for path in found] == [[1, 2, 3], [1, 4, 3]]
    taken = [way for path in found for way in directions(path.hops)]
    assert len(set(taken)) == len(taken)
    assert route(network, [*legs, Leg(SwitchPort(1, 3), SwitchPort(3, 3))], Limits()) is None


@pytest.mark.parametrize("taken", directions(BY_TWO)[1:-1])
def test_a_route_of_which_others_have_a_part_goes_another_way(taken: Direction) -> None:
    network, legs = ring(), [Leg(START, END)]
    for blocked, way in ((set(), BY_TWO), ({taken}, BY_FOUR), (set(), BY_TWO)):
        found = route(network, legs, Limits(blocked.__contains__))
        assert found is not None
        assert [path.hops for path in found] == [way]


def test_an_early_leg_makes_room_for_a_later_one() -> None:
    network = ring()
    # Alone, the first leg would go by 2; the way round is too long for the second.
    network.optics.switches = {2: rotating(0, 10), 4: rotating(0, 50)}
    near = Leg(SwitchPort(1, 2), SwitchPort(2, 2))
    found = route(network, [Leg(START, END), near], Limits(loss_budget_mdb=55))
    assert found is not None
    assert [switches(path.hops) for path in found] == [[1, 4, 3], [1, 2]]


def test_no_order_of_legs_is_tried_if_one_has_no_path_even_alone() -> None:
    """Each search asks for both of its ends: twice for the one that is taken, not six times."""
    network, asked = ring(), []
    taken = Direction(3, 3, False)

    def blocked(way: Direction) -> bool:
        asked.append(way)
        return way == taken

    legs = [Leg(SwitchPort(1, place), SwitchPort(3, place)) for place in (1, 2, 3)]
    assert route(network, legs, Limits(blocked)) is None
    assert asked.count(taken) == 2


def test_a_path_is_found_beside_those_that_stay() -> None:
    network = ring()
    stays = LightPath(BY_TWO, 0, 0)
    found = route(network, [Leg(SwitchPort(1, 2), SwitchPort(3, 2))], Limits(), [stays])
    assert found is not None
    assert switches(found[0].hops) == [1, 4, 3]


@pytest.mark.parametrize(
    ("limits", "reason"),
    [
        (Limits(blocked=lambda way: way == Direction(*END, False)), Reason.BUSY),
        (Limits(loss_budget_mdb=100), Reason.LOSS_TOO_HIGH),
        (Limits(frequency_mhz=CHANNEL_MHZ + 50_000), Reason.NO_WAVELENGTH),
    ],
)
def test_what_stands_in_the_way_is_named(limits: Limits, reason: Reason) -> None:
    network = ring()
    network.optics.switches = {2: rotating(0, 200), 4: rotating(0, 300)}
    network.optics.described(END, band(CHANNEL_MHZ, CHANNEL_MHZ))
    assert route(network, [Leg(START, END)], limits) is None
    assert why_not(network, [Leg(START, END)], limits) == reason
    network.connected.discard(3)
    assert why_not(network, [Leg(START, END)], limits) == Reason.NO_PATH


def test_what_stands_in_the_way_is_found_out_anew_when_the_network_is_another() -> None:
    network = ring()
    network.names = {number: f"q{number}" for number in (1, 2, 3, 4)}
    limits = Limits(lambda way: way == Direction(*END, False), CHANNEL_MHZ, 100)

    def reason() -> Reason:
        assert route(network, [Leg(START, END)], limits) is None
        return why_not(network, [Leg(START, END)], limits)

    assert reason() == Reason.BUSY
    for dpid in (2, 4):
        network.optics.take(dpid, rotating(0, 200))
    assert reason() == Reason.LOSS_TOO_HIGH
    network.optics.described(END, band(CHANNEL_MHZ + 50_000, CHANNEL_MHZ + 50_000))
    assert reason() == Reason.NO_WAVELENGTH
    network.closed = frozenset({frozenset({"q1", "q2"}), frozenset({"q3", "q4"})})
    assert reason() == Reason.NO_PATH
    network.closed = frozenset()
    assert reason() == Reason.NO_WAVELENGTH
    network.remove_link(SwitchPort(1, 12))
    network.set_fiber(SwitchPort(4, 43), whole=False)
    assert reason() == Reason.NO_PATH


def test_what_was_measured_is_forgotten_with_a_cut_and_with_the_switch() -> None:
    network = ring()
    network.optics.measured(START, light(rx_power=-400))
    network.set_fiber(START, whole=False)
    network.set_fiber(START, whole=True)
    found = path(network)
    assert found is not None
    assert found.loss_mdb == 0
    network.optics.measured(START, light(rx_power=-400))
    network.optics.described(START, band(OTHER_MHZ, OTHER_MHZ))
    network.optics.switches[1] = rotating(2)
    network.optics.forget_switch(1)
    assert network.optics == Optics()
