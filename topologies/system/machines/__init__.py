"""Machines that share a network with the first one, on which the runner is."""
