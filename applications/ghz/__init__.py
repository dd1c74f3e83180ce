"""GHZ states of several hosts: pairs between neighbours, which the hosts between them fuse."""
