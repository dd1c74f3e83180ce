"""Labs: published results, held beside runs of the network (docs/labs.md)."""
