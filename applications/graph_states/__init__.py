"""Graph states of several hosts: a pair for each edge, fused at the hosts."""
