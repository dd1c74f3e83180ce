"""Questions to a running network: controller, dispatcher, events, the machine it is on."""
