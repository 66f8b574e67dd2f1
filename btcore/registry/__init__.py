"""The registry: which nodes a tree may use, and how each of them is created."""
