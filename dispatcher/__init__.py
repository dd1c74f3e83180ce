"""The dispatcher: one process that holds every qubit of the network and moves its light."""
