"""Keys of the whole network, as the controller knows it: links, routes, applications."""
