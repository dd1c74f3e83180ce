"""Sessions of any service: channel, arrangement, light, options, what a service is made of."""
