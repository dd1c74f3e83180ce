"""Confinement: programs on a host, or a whole network, see nothing of the rest."""
