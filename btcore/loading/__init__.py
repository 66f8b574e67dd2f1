"""Load a tree in one call, reload it when its file changes, and export its blackboards."""
