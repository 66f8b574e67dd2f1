"""Settings: the options of providers, and those of every run."""

from collections import Counter
from collections.abc import Iterable, Iterator, Set
from typing import Annotated, TypeVar

from btcore.errors import SettingsError
from btcore.options import Options, check_settings, option, required_option_names

AnySettings = TypeVar("AnySettings", bound="Settings")


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

    def check_environment(self) -> None:
        """Check what the settings need of the machine, such as files, packages or a display.

        A run calls it for the settings of the used providers before it opens the first of them, so that it
        does not fail after a robot has started. The default does nothing.

        Raises:
            BtcoreError: Something is missing.
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


class GivenSettings:
    """The settings that were given for a run, one object of each class. Other classes have their defaults.

    Raises:
        SettingsError: A value is invalid, or a class is given several times.
        TypeError: An object is no settings object.
    """

    def __init__(self, settings: Iterable[Settings] = ()) -> None:
        settings = list(settings)
        for settings_class, count in Counter(map(type, settings)).items():
            if count > 1:
                raise SettingsError(f"{settings_class.__name__} are given {count} times")
        self._by_class = {type(given): check_settings(given) for given in settings}

    def __iter__(self) -> Iterator[Settings]:
        return iter(self._by_class.values())

    @property
    def classes(self) -> Set[type[Settings]]:
        """The classes of the given settings."""
        return self._by_class.keys()

    def replace(self, settings: Settings) -> None:
        """Use *settings* in place of those of their class."""
        self._by_class[type(settings)] = settings

    def of(self, settings_class: type[AnySettings]) -> AnySettings:
        """Return the settings of a class, given or with their defaults.

        Raises:
            TypeError: They have a required option, which was not given.
        """
        given = self._by_class.get(settings_class)
        return settings_class() if given is None else given  # type: ignore[return-value]

    def find(self, settings_class: type[AnySettings]) -> AnySettings | None:
        """Return the settings of a class; None if a required option was not given."""
        is_missing = settings_class not in self.classes and required_option_names(settings_class)
        return None if is_missing else self.of(settings_class)
