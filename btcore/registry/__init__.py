"""The registry of the nodes that a tree may use, with the information to create each node."""
