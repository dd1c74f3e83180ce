"""Light on its way through fibres and switches."""
