"""The Tree, and breakpoints in it."""
