"""The Tree: ticking, halting, waiting, breakpoints and saved state."""
