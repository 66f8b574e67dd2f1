"""The robot's body: a simulated world, and a Tiago of primitive shapes in it."""
