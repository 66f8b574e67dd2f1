"""A simulated world with physics, and a Tiago robot made of primitive shapes in it."""
