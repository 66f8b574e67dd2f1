"""What a user can get wrong about worlds and robots, said as sentences."""


class SimError(Exception):
    """A world, a robot or a fault can't be had as asked for; the text says why and what to do."""
