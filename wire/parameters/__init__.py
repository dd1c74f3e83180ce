"""Parameters of devices and fibres, with their units and ranges."""
