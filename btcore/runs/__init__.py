"""Running trees: providers of what leaves need, their settings, and runs."""
