"""The built-in nodes, one family a file."""
