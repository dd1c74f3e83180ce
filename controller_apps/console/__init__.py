"""The controller's console and its REST interface."""
