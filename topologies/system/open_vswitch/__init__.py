"""Open vSwitch on this machine: its daemons, bridges and ports."""
