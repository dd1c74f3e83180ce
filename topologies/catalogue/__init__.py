"""Named sets of what a topology is made of, each with its source: presets, kinds of nodes, maps."""
