"""Hardware layer: the optics behind the switch, whatever they are."""
