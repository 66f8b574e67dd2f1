"""Choosing the providers of a run: which are used, and in which order they are opened.

A provider of a type is used if a leaf or a used provider needs the type, and no object of the program has it.
A side-effect provider is used if one of its settings was given. The candidates for a type are its providers
whose required options were given, and whose own needs can be provided. Of several candidates, one is used:

1. the provider that takes the most of the given settings with a required option. With `--ros2 tiago`,
   `ros_robot` is used instead of `simulator`; with `--bag F`, too, `bag_robot`, which takes both settings;
2. then a provider that is used for another type anyway: in a run that explores, the `Servers` are those of
   `exploration`, and not those of `navigation`;
3. then the user's provider, such as a plugin's robot, and not an installed one;
4. then a provider that is not a default. `simulator` is a default.

If several are left, an error asks for an option. The other candidates are rejected: they are used for no
other type either, and neither is a provider that needs what only they provide. With `--ros2 tiago`, the
map of the simulated world is not used, because it does not fit the robot.

The choice consists of rounds. Each round follows the needs from the leaves, through types with a single
candidate, to a type with several candidates, and rejects all but the best of them. In the last round each
needed type has a single candidate. Then, if no used provider is a clock, a provider of nothing but a clock is
used, too, if everything that it needs is provided anyway; a run with providers of the core alone does not
search for such a provider.
"""

from collections.abc import Iterable, Mapping, Sequence, Set
from typing import NamedTuple

from btcore.clock import Clock
from btcore.errors import ProviderError
from btcore.options import required_option_names
from btcore.registry.resources import TypeRef, describe_ambiguity, fits, full_name
from btcore.runs.available_providers import AvailableProviders
from btcore.runs.providers import Provider
from btcore.runs.settings import RunSettings, Settings
from btcore.suggestions import join_names, with_article

_CLOCK = full_name(Clock)


class Choice(NamedTuple):
    """The used providers.

    Attributes:
        order: The providers, each after those that it needs. Those that need the tree are opened later.
        providers: The provider of each needed type, by the full name of the type.
        objects: The objects of the program for the other types, by the full name of the type.
        problems: Why nothing is provided for a type, by its full name.
        rejected: The providers that are not used because another provider, or the program, provides one of
            their types, with the reason.
    """

    order: Sequence[Provider] = ()
    providers: Mapping[str, Provider] = {}
    objects: Mapping[str, object] = {}
    problems: Mapping[str, str] = {}
    rejected: Mapping[Provider, str] = {}

    def opens_after_tree(self, provider: Provider) -> bool:
        """Return whether a used provider needs the tree, or what such a provider provides.

        It is opened when the tree was created, so that leaves cannot get what it provides.
        """
        return provider.needs_tree or any(map(self.opens_after_tree, self.providers_for(provider)))

    def providers_for(self, provider: Provider) -> list[Provider]:
        """Return the used providers of the objects that *provider* needs."""
        names = [need.type_name for need in provider.object_needs]
        return [self.providers[name] for name in names if name in self.providers]

    @property
    def clock(self) -> Provider | None:
        """The provider of the run's clock, or None."""
        return next((provider for provider in self.order if provider.provides_clock), None)


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
        given: The classes of the settings that were given.
        resources: Objects of the program, which are preferred to providers.
        optional_types: Types that the program can do without. A provider that is used for one of them alone
            is not preferred for the needed types.

    Raises:
        ProviderError: Two providers are equally good, or need each other, or a side-effect provider needs
            what nothing provides.
    """
    side_effects = [
        provider
        for provider in available.with_side_effects(given - {RunSettings})
        if given >= set(provider.required_settings)
    ]
    rejected: dict[Provider, str] = {}
    while True:
        this_round = _Round(available, given, resources, rejected)
        newly_rejected = this_round.assign_all(needed_types, optional_types, side_effects)
        if not newly_rejected:
            return this_round.result()
        rejected |= newly_rejected


class _Request(NamedTuple):
    """A needed type, and what can be provided for it.

    Attributes:
        type: The type.
        is_optional: Whether the type may be missing.
        chain: The providers that lead to the type from a leaf or from a side-effect provider.
        own: The object of the program, or None.
        candidates: The providers that can be used, if the program has no object.
        problem: Why nothing can be provided, or "".
    """

    type: TypeRef
    is_optional: bool
    chain: tuple[Provider, ...]
    own: object
    candidates: list[Provider]
    problem: str

    @property
    def name(self) -> str:
        """The full name of the type."""
        return full_name(self.type)


class _Round:
    """A round of the choice: it assigns a provider to each needed type, or rejects further providers."""

    def __init__(
        self,
        available: AvailableProviders,
        given: Set[type[Settings]],
        resources: Sequence[object],
        rejected: Mapping[Provider, str],
    ) -> None:
        self._available = available
        self._given = given
        self._resources = resources
        self._rejected = rejected
        self._pending: list[_Request] = []
        self._used: dict[Provider, None] = {}
        self._providers: dict[str, Provider] = {}
        self._objects: dict[str, object] = {}
        self._problems: dict[str, str] = {}

    # --- what can be provided: `_request` and `_find_obstacle` call each other

    def _request(
        self, type: TypeRef, is_optional: bool = False, chain: tuple[Provider, ...] = ()
    ) -> _Request:
        own = self._find_own(type)
        if own is not None:
            return _Request(type, is_optional, chain, own, [], "")
        obstacles = {
            provider: self._find_obstacle(provider, chain)
            for provider in self._available.of_type(full_name(type))
        }
        candidates = [provider for provider, obstacle in obstacles.items() if not obstacle]
        problem = "" if candidates else self._describe_problem(type, chain, obstacles)
        return _Request(type, is_optional, chain, None, candidates, problem)

    def _find_own(self, type: TypeRef) -> object:
        """Return the object of the program for a type, or None."""
        fitting = [resource for resource in self._resources if fits(resource, type)]
        if problem := describe_ambiguity(fitting, f"the type {_title(type)}"):
            raise ProviderError(problem)
        return next(iter(fitting), None)

    def _find_obstacle(self, provider: Provider, chain: tuple[Provider, ...]) -> str:
        """Return why a provider of a type is no candidate, or ""; *chain* leads to the type."""
        if provider in self._rejected:
            return f"is not used, because {self._rejected[provider]}"
        if provider in chain:
            return f"needs itself: {_join([*chain, provider])}"
        missing = [cls for cls in provider.required_settings if cls not in self._given]
        if missing:
            options = [name for cls in missing for name in required_option_names(cls)]
            return f"is not used without {join_names(options)}"
        for need in provider.object_needs:
            problem = "" if need.is_optional else self._request(need.type, False, (*chain, provider)).problem
            if problem:
                return f"needs {title_with_article(need.type)}, but {problem}"
        return ""

    def _describe_problem(
        self, type: TypeRef, chain: tuple[Provider, ...], obstacles: Mapping[Provider, str]
    ) -> str:
        name, title = full_name(type), _title(type)
        reasons = [f"{provider} {obstacle}" for provider, obstacle in obstacles.items()]
        reasons += (
            f"{provider} provides {other}, and not {name}: the file of the class was loaded twice"
            for provider in self._available.of_user
            for other in provider.type_names
            if other != name and _title(other) == title
        )
        problem = f"nothing provides {title_with_article(type)}"
        if reasons:
            return f"{problem}: {'; '.join(reasons)}"
        return f"{problem} ({_join(chain)} needs {title_with_article(type)})" if chain else problem

    # --- what is provided

    def assign_all(
        self,
        needed_types: Iterable[TypeRef],
        optional_types: Iterable[TypeRef],
        side_effects: Iterable[Provider],
    ) -> dict[Provider, str]:
        """Assign providers to needed types, until others are rejected; return these with the reasons."""
        self._pending = [self._request(type) for type in needed_types]
        self._pending += [self._request(type, is_optional=True) for type in optional_types]
        for provider in side_effects:
            self._use(provider, ())
        while self._pending:
            # Needed types come before optional ones, and types with a single candidate before others: this
            # candidate is then preferred for the other types.
            request = min(self._pending, key=lambda each: (each.is_optional, len(each.candidates) > 1))
            self._pending.remove(request)
            if request.name not in (*self._providers, *self._objects):
                rejected = self._assign(request)
                if rejected:
                    return rejected
        return {}

    def _assign(self, request: _Request) -> dict[Provider, str]:
        """Assign an object of the program or the only candidate; or return the providers to reject."""
        if request.own is not None:
            self._objects[request.name] = request.own
            providers = self._available.of_type(request.name)
            others = [provider for provider in providers if provider not in self._rejected]
            return dict.fromkeys(others, f"the program provides the {_title(request.type)}")
        if request.problem:
            self._problems[request.name] = request.problem
            if request.chain and not request.is_optional:
                raise ProviderError(request.problem)
            return {}
        best = self._select_best(request)
        others = [provider for provider in request.candidates if provider is not best]
        if not others:
            self._providers[request.name] = best
            self._use(best, request.chain)
        return dict.fromkeys(others, f"{best.name} provides the {_title(request.type)}")

    def _use(self, provider: Provider, chain: tuple[Provider, ...]) -> None:
        if provider not in self._used:
            self._used[provider] = None
            self._pending += (
                self._request(need.type, need.is_optional, (*chain, provider))
                for need in provider.object_needs
            )

    def _select_best(self, request: _Request) -> Provider:
        ranks = {provider: self._rank(provider) for provider in request.candidates}
        best = [provider for provider, rank in ranks.items() if rank == max(ranks.values())]
        if len(best) != 1:
            title, needer = title_with_article(request.type), _join(request.chain) or "a leaf"
            raise ProviderError(
                f"{len(best)} providers provide {title}: {join_names(map(repr, best))}; "
                f"{needer} needs {title}. Choose one by an option, or pass the object"
            )
        return best[0]

    def _rank(self, provider: Provider) -> tuple[int, bool, bool, bool]:
        """Return the criteria 1 to 4 of the module's docstring; the greatest rank is best."""
        given = self._given & set(provider.settings_classes)
        return (
            sum(bool(required_option_names(cls)) for cls in given),
            provider in self._used,
            provider in self._available.of_user,
            not provider.is_default,
        )

    # --- the result

    def result(self) -> Choice:
        """Return the choice, when a provider or an object is assigned to each needed type."""
        self._add_clock()
        choice = Choice([], self._providers, self._objects, self._problems, self._rejected)
        order: list[Provider] = []
        for provider in self._used:
            self._append_after_needs(provider, (), choice, order)
        return choice._replace(order=order)

    def _add_clock(self) -> None:
        """Use a provider of nothing but a clock, such as `ros_clock`; the module's docstring has the rule."""
        clocks = [provider for provider in self._used if provider.provides_clock]
        if len(clocks) > 1:
            names = join_names(map(repr, clocks))
            raise ProviderError(
                f"a run has one clock, but {len(clocks)} of its providers are clocks: {names}"
            )
        uses_core_alone = not self._resources and self._used.keys() <= set(self._available.core)
        if clocks or uses_core_alone:
            return
        for provider in self._available.of_type(_CLOCK):
            own = {
                need.type_name: self._find_own(need.type)
                for need in provider.object_needs
                if need.type_name not in self._providers
            }
            if None not in own.values() and set(map(full_name, provider.types)) == {_CLOCK}:
                self._used[provider] = None
                self._objects |= own
                return

    def _append_after_needs(
        self, provider: Provider, chain: tuple[Provider, ...], choice: Choice, order: list[Provider]
    ) -> None:
        if provider in order:
            return
        if provider in chain:
            raise ProviderError(
                f"providers need each other: {_join([*chain[chain.index(provider) :], provider])}"
            )
        needed = choice.providers_for(provider)
        if any(need.type is Clock for need in provider.needs):
            needed += [other for other in self._used if other.provides_clock]
        for other in needed:
            self._append_after_needs(other, (*chain, provider), choice, order)
        order.append(provider)


def _title(needed_type: TypeRef) -> str:
    return full_name(needed_type).rpartition(".")[2]


def title_with_article(needed_type: TypeRef) -> str:
    """Return the name of a type without its module, with an article."""
    return with_article(_title(needed_type))


def _join(chain: Sequence[Provider]) -> str:
    return " → ".join(map(repr, chain))
