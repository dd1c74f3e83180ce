"""Three buildings with two users each, fibres between all of them, a source in the first."""

from topologies.fabric import FabricTopo
from topologies.nodes import OpticalSwitch
from wire.parameters.physics import PairSource

WAYS = {("q1", "q2"): (0.25, 0.05), ("q1", "q3"): (1.2, 0.6), ("q2", "q3"): (0.93, 3.6)}  # km, dB
USERS = {"q1": ("alice", "avery"), "q2": ("bob", "bailey"), "q3": ("charlie", "casey")}
LOSS_DB = {"avery": 1.26, "bob": 2.05, "bailey": 2.05, "charlie": 2.1, "casey": 2.1}


class Campus(FabricTopo):
    def build(self) -> None:
        """Lay copper and fibre."""
        self.set_up()
        for switch, users in USERS.items():
            self.addSwitch(switch, cls=OpticalSwitch, insertion_loss_db=7.25)
            for user in users:
                self.add_host(user, self.next_address())
                self.join(user, switch, 1, connectors_db=LOSS_DB.get(user, 0.0))
        for ends, (length_km, loss_db) in WAYS.items():
            self.join(*ends, 2, length_km=length_km, connectors_db=loss_db)
        self.add_host("source", self.next_address(), source=PairSource(fidelity=0.978))
        self.join("source", "q1", 2)
        self.add_dispatcher(self.next_address())
