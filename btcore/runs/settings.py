"""Settings: the options of providers, and those of every run."""

from typing import Annotated

from btcore.options import Options, option


class Settings(Options):
    """The options of a provider, which every command with a run has.

    A field without a default is required: its provider is used only if the option is given. Required fields
    come first. `__post_init__` may check several settings together and raise a `SettingsError`.

    Examples:
        >>> from typing import Annotated
        >>> import btcore
        >>> class GripperSettings(btcore.Settings):
        ...     port: Annotated[str, btcore.option("Serial port of the gripper.", metavar="PORT")]
        ...     force: Annotated[float, btcore.option("Greatest force, in N.", gt=0)] = 20.0
        >>> GripperSettings("/dev/ttyUSB0").force
        20.0
    """


class RunSettings(Settings):
    """The settings of every run, which any provider can use as a parameter.

    Attributes:
        rate: Ticks per second of the run's clock (Hz).
        duration: The limit of the run (s of its clock), or None.
        seed: The seed of the random numbers.
        fast: Whether simulated time passes as fast as possible.
    """

    rate: Annotated[float, option("Ticks per second.", metavar="HZ", gt=0, le=10_000)] = 10.0
    duration: (
        Annotated[float, option("End the run after S seconds of the tree's clock.", metavar="S", gt=0)] | None
    ) = None
    seed: Annotated[
        int, option("Seed of the random numbers; the same seed reproduces the same run.", metavar="N", ge=0)
    ] = 0
    fast: Annotated[bool, option("Use simulated time and run as fast as possible.")] = False
