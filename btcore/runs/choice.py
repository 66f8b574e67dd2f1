"""Choosing the providers of a run: which are used, and in which order they are opened.

A provider is used if a leaf or a used provider needs one of its types; a side-effect provider, if one of its
settings was given. The candidates for a type are its providers whose required options were given. They are
ranked by these criteria, of which an earlier one counts more:

1. how many of the given settings with a required option the provider takes. With `--ros2 tiago`, `ros_robot`
   is used instead of `simulator`; with `--bag F`, too, `bag_robot`, which takes both settings;
2. how many of the types that the leaves need it provides. In a tree that explores, the `Servers` are those of
   `exploration`, and not those of `navigation`;
3. whether it is the user's, such as a plugin's robot, and not an installed one;
4. whether it is not a default. `simulator` is a default.

A provider is rejected if a candidate of a higher rank, or the program, provides one of its types. It is used
for no other type either: with `--ros2 tiago`, `simulator` provides no `Simulation`, so that the map of the
simulated world is not used, which does not fit the robot. Two candidates of the same rank are an error if the
needs of both can be provided.

The clock of the run is that of a used provider. If there is none, a provider of nothing but a clock is used,
too, if everything that it needs is provided anyway.
"""

from collections.abc import Iterable, Mapping, Sequence, Set
from math import inf
from typing import Final, NamedTuple

from btcore.clock import Clock
from btcore.errors import ProviderError
from btcore.options import required_option_names
from btcore.registry.resources import TypeRef, describe_ambiguity, fits, full_name
from btcore.runs.available_providers import AvailableProviders
from btcore.runs.providers import Provider
from btcore.runs.settings import RunSettings, Settings
from btcore.suggestions import join_names, with_article

_CLOCK: Final = full_name(Clock)
_Rank = tuple[float, int, bool, bool]
_RANK_OF_PROGRAM: Final[_Rank] = (inf, 0, False, False)


class Source(NamedTuple):
    """Where the object of a type comes from.

    Attributes:
        own: The object of the program, or None.
        provider: The provider of the object, or None.
        problem: Why there is neither, or "".
    """

    own: object = None
    provider: Provider | None = None
    problem: str = ""


class Choice(NamedTuple):
    """The used providers.

    Attributes:
        order: The providers, each after those that it needs; that of the clock as early as possible.
        sources: Where the objects of the needed types come from, by the full names of the types.
        rejected: The rejected providers, with the reason.
        clock: The provider of the run's clock, or None.
    """

    order: Sequence[Provider] = ()
    sources: Mapping[str, Source] = {}
    rejected: Mapping[Provider, str] = {}
    clock: Provider | None = None


def choose_providers(
    needed_types: Sequence[TypeRef],
    available: AvailableProviders,
    given: Set[type[Settings]],
    resources: Sequence[object] = (),
    optional_types: Sequence[TypeRef] = (),
) -> Choice:
    """Return the providers of a run.

    Args:
        needed_types: The types that the leaves of the tree need, and those that the program wants.
        available: The providers that can be used.
        given: The classes of the settings that were given.
        resources: Objects of the program, which are preferred to providers.
        optional_types: Types that the program can do without. They do not count for the rank.

    Raises:
        ProviderError: Two candidates have the same rank, or a provider needs itself, or a side-effect
            provider needs what nothing provides, or a run has two clocks.
    """
    return _Resolver(needed_types, available, given, resources).choose(optional_types)


class _Resolver:
    """Finds the sources of the needed types."""

    def __init__(
        self,
        needed_types: Sequence[TypeRef],
        available: AvailableProviders,
        given: Set[type[Settings]],
        resources: Sequence[object],
    ) -> None:
        self._needed_types = needed_types
        self._available = available
        self._given = given
        self._resources = resources
        self._rejected: dict[Provider, str] = {}
        self._sources: dict[str, Source] = {}

    def choose(self, optional_types: Iterable[TypeRef]) -> Choice:
        types = [*self._needed_types, *optional_types]
        side_effects = [
            provider
            for provider in self._available.with_side_effects(self._given - {RunSettings})
            if not self._missing_settings(provider)
        ]
        self._reject([*types, *(need.type for each in side_effects for need in each.object_needs)])
        used = [source.provider for source in map(self._find_source, types) if source.provider]
        for provider in side_effects:
            if obstacle := self._find_obstacle(provider):
                raise ProviderError(f"{provider} {obstacle}")
        used += side_effects
        clock = self._find_clock(self._in_order(used))
        order = self._in_order(used if clock is None else [clock, *used])
        return Choice(order, self._sources, self._rejected, clock)

    # --- the rank

    def _reject(self, types: Iterable[TypeRef]) -> None:
        """Reject candidates for *types*, and for the types that the candidates need, and so on."""
        possible_types = self._find_possible_types(types)
        owners = {
            name: (_RANK_OF_PROGRAM, "the program")
            for name, type in possible_types.items()
            if self._find_own(type) is not None
        }
        candidates = {each: None for name in possible_types for each in self._candidates(name)}
        for candidate in sorted(candidates, key=self._rank, reverse=True):
            rank = self._rank(candidate)
            names = [name for name in possible_types if name in candidate.type_names]
            better = [name for name in names if name in owners and owners[name][0] > rank]
            if better:
                self._rejected[candidate] = f"{owners[better[0]][1]} provides the {_title(better[0])}"
            else:
                owners = {**dict.fromkeys(names, (rank, candidate.name)), **owners}

    def _find_possible_types(self, types: Iterable[TypeRef]) -> dict[str, TypeRef]:
        """Return *types*, and the types that their candidates need, and so on, by their full names."""
        found: dict[str, TypeRef] = {}
        pending = list(types)
        while pending:
            type = pending.pop(0)
            if full_name(type) not in found:
                found[full_name(type)] = type
                candidates = self._candidates(full_name(type))
                pending += (need.type for candidate in candidates for need in candidate.object_needs)
        return found

    def _candidates(self, type_name: str) -> list[Provider]:
        providers = self._available.of_type(type_name)
        return [provider for provider in providers if not self._missing_settings(provider)]

    def _missing_settings(self, provider: Provider) -> list[type[Settings]]:
        return [cls for cls in provider.required_settings if cls not in self._given]

    def _rank(self, provider: Provider) -> _Rank:
        """Return the criteria of the module's docstring; the greatest rank is best."""
        given = self._given & set(provider.settings_classes)
        return (
            sum(bool(required_option_names(cls)) for cls in given),
            len(provider.type_names.intersection(map(full_name, self._needed_types))),
            provider in self._available.of_user,
            not provider.is_default,
        )

    # --- the sources: `_find_source` and `_find_obstacle` call each other

    def _find_source(self, type: TypeRef, chain: tuple[Provider, ...] = ()) -> Source:
        """Return the source of a type, which the last provider of *chain* needs."""
        name = full_name(type)
        if name not in self._sources:
            own = self._find_own(type)
            self._sources[name] = self._find_provider(type, chain) if own is None else Source(own)
        return self._sources[name]

    def _find_own(self, type: TypeRef) -> object:
        """Return the object of the program for a type, or None."""
        fitting = [resource for resource in self._resources if fits(resource, type)]
        if problem := describe_ambiguity(fitting, f"the type {_title(type)}"):
            raise ProviderError(problem)
        return next(iter(fitting), None)

    def _find_provider(self, type: TypeRef, chain: tuple[Provider, ...]) -> Source:
        title = title_with_article(type)
        providers = self._available.of_type(full_name(type))
        obstacles = {provider: self._find_obstacle(provider, chain) for provider in providers}
        possible = [provider for provider, obstacle in obstacles.items() if not obstacle]
        if len(possible) > 1:
            raise ProviderError(
                f"{len(possible)} providers provide {title}: {join_names(map(repr, possible))}; "
                f"{_join(chain) or 'a leaf'} needs {title}. Choose one by an option, or pass the object"
            )
        if possible:
            return Source(provider=possible[0])
        reasons = "; ".join(f"{provider} {obstacle}" for provider, obstacle in obstacles.items())
        return Source(problem=f"nothing provides {title}{reasons and ': '}{reasons}")

    def _find_obstacle(self, provider: Provider, chain: tuple[Provider, ...] = ()) -> str:
        """Return why a provider cannot be used, or ""; *chain* leads to its type."""
        if provider in self._rejected:
            return f"is not used, because {self._rejected[provider]}"
        if missing := self._missing_settings(provider):
            options = [name for cls in missing for name in required_option_names(cls)]
            return f"is not used without {join_names(options)}"
        if provider in chain:
            raise ProviderError(f"{provider} needs itself: {_join([*chain, provider])}")
        for need in provider.object_needs:
            problem = self._find_source(need.type, (*chain, provider)).problem
            if problem and not need.is_optional:
                return f"needs {title_with_article(need.type)}, but {problem}"
        return ""

    # --- the result

    def _in_order(self, providers: Iterable[Provider]) -> list[Provider]:
        """Return the providers, and those that they need, each after those that it needs."""
        order: list[Provider] = []

        def append(provider: Provider) -> None:
            if provider not in order:
                for need in provider.object_needs:
                    source = self._sources[need.type_name]
                    if source.provider is not None:
                        append(source.provider)
                order.append(provider)

        for provider in providers:
            append(provider)
        return order

    def _find_clock(self, used: Sequence[Provider]) -> Provider | None:
        """Return the provider of the clock, beside the other *used* providers; see the module's docstring."""
        clocks = [provider for provider in used if provider.provides_clock]
        if len(clocks) > 1:
            names = join_names(map(repr, clocks))
            raise ProviderError(
                f"a run has one clock, but {len(clocks)} of its providers are clocks: {names}"
            )
        # For a run of the core alone, no other package is imported.
        uses_others = self._resources or not set(used) <= set(self._available.core)
        if not clocks and uses_others:
            for provider in self._available.of_type(_CLOCK):
                sources = [self._find_source(need.type) for need in provider.object_needs]
                are_used = all(source.own is not None or source.provider in used for source in sources)
                if are_used and set(map(full_name, provider.types)) == {_CLOCK}:
                    return provider
        return next(iter(clocks), None)


def _title(needed_type: TypeRef) -> str:
    return full_name(needed_type).rpartition(".")[2]


def title_with_article(needed_type: TypeRef) -> str:
    """Return the name of a type without its module, with an article."""
    return with_article(_title(needed_type))


def _join(chain: Sequence[Provider]) -> str:
    return " → ".join(map(repr, chain))
