"""The content of a topology, checked before anything of it is made."""
