"""What ticks: nodes, leaves, and what surrounds a tick."""
