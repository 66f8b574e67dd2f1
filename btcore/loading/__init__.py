"""Load a tree in one call, reload it when its file changes, build it in Python, and write it as XML."""
