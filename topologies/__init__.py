"""Mininet nodes, fibre links and topologies, and what starts and ends them."""
