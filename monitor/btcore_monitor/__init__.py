"""The monitor: publishes a running tree, and shows or records any tree that is published."""
