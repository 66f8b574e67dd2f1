"""Choosing the providers of a run: which are used, and in which order they are opened.

A provider of a type is used if a leaf or a used provider needs the type, and no object of the program has it.
A provider of nothing is used if one of its settings was given. If several provide a type, the
first of these differences decides (`_Rank`):

1. A required option of the provider was given.
2. The provider is used for another type anyway.
3. The provider is the user's, not an installed one.
4. The provider needs other objects, and only such as are used anyway.
5. The provider is not a default.

If two are equally good, the one that takes the required settings of the other, too, is used.

A provider that lost a type is not used for any other type, and neither is a provider that needs what only a
loser provides: the map of a simulated world does not fit another robot. Therefore the choice begins anew
whenever a provider has lost. Types with a single candidate are assigned first.

For example, the leaves of `btcore run patrolling --ros2 tiago --map house.yaml` need a `Robot`, `Waypoints`
and a `PoseNavigator`:

1. `simulator` and `ros_robot` provide a `Robot`. The required option of `ros_robot`, `--ros2`, was given, so
   that `simulator` loses, and the choice begins anew.
2. `navigator` provides the `PoseNavigator`, and needs a `Navigation`, which needs an `OccupancyMap`. It is
   that of `map_file`: `world_map` needs the world of `simulator`, which has lost.
3. The order is: `ros_session`, which `ros_robot` needs, `ros_robot`, `waypoints`, `map_file`, `navigation`,
   `navigator`.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

from btcore.clock import Clock
from btcore.errors import ProviderError
from btcore.options import required_option_names
from btcore.runs.available_providers import AvailableProviders
from btcore.runs.providers import TYPES_OF_RUN, Need, Provider, fits, full_name, is_settings
from btcore.runs.settings import RunSettings, Settings
from btcore.suggestions import join_names, with_article

S = TypeVar("S", bound=Settings)

_CLOCK = full_name(Clock)


class GivenSettings(dict[type[Settings], Settings]):
    """The settings that were given for a run, by their classes. A class that is missing has its defaults."""

    def __init__(self, settings: Iterable[Settings] = ()) -> None:
        super().__init__((type(item), item) for item in settings)

    def find(self, kind: type[S]) -> S | None:
        """Return the settings of the class *kind*; None if a required one was not given."""
        found = self.get(kind)
        if found is None and not required_option_names(kind):
            found = kind()
        return found  # type: ignore[return-value]


class Choice(NamedTuple):
    """The used providers.

    Attributes:
        order: The providers, each after those that it needs. Those that follow the tree are opened later.
        by_type: What is provided for each needed type, by its full name: a provider, or an object of the
            program.
        problems: Why nothing is provided for a type, by its full name.
        losers: The providers that were not chosen, with the type and the provider that was chosen, or None if
            the program has an object of the type.
    """

    order: list[Provider]
    by_type: Mapping[str, object]
    problems: Mapping[str, str]
    losers: Mapping[Provider, tuple[Any, Provider | None]]

    def follows_tree(self, provider: Provider) -> bool:
        """Return whether a used provider needs the tree, or what such a provider provides.

        It is opened when the tree was created, so that leaves cannot get what it provides.
        """
        return provider.needs_tree or any(map(self.follows_tree, self.providers_for(provider)))

    def providers_for(self, provider: Provider) -> list[Provider]:
        """Return the used providers of the objects that *provider* needs."""
        found = (self.by_type.get(full_name(need.type)) for need in _needs(provider))
        return [other for other in found if isinstance(other, Provider)]

    @property
    def clock(self) -> Provider | None:
        """The provider of the run's clock, or None."""
        return next((provider for provider in self.order if provider.provides_clock), None)


def choose(
    needed: Sequence[Any],
    available: AvailableProviders,
    settings: GivenSettings,
    provided: Sequence[object] = (),
    optional: Sequence[Any] = (),
) -> Choice:
    """Return the providers of a run.

    Args:
        needed: The types that the leaves of the tree need, and those that the program wants.
        provided: Objects of the program, which are preferred to providers.
        optional: Types that the program can do without. A provider that is used for one of them alone is not
            preferred for the types that are needed.

    Raises:
        ProviderError: Two providers are equally good, or need each other, or a provider of nothing needs what
            nothing provides.
    """
    candidates = available.of_nothing(settings.keys() - {RunSettings})
    starters = [provider for provider in candidates if _has_settings(provider, settings)]
    requests = [
        *(_Request(kind, False, ()) for kind in needed),
        *(_Request(kind, True, ()) for kind in optional),
    ]
    losers: dict[Provider, tuple[Any, Provider | None]] = {}
    while True:
        attempt = _Attempt(available, settings, provided, losers)
        if attempt.assign(requests, starters):
            return attempt.result()


def _has_settings(provider: Provider, settings: GivenSettings) -> bool:
    return all(optional or settings.find(kind) is not None for kind, optional in provider.settings.items())


class _Request(NamedTuple):
    """A needed type, and the providers that lead to it from a leaf or from a provider of nothing."""

    type: Any
    is_optional: bool
    chain: tuple[Provider, ...]


class _Rank(NamedTuple):
    """How good a provider is for a type; the greater rank is better. The module explains the order."""

    was_required: bool
    is_used: bool
    is_of_user: bool
    needs_only_used: bool
    is_no_default: bool


class _Attempt:
    """An attempt to assign a provider to each needed type. It ends when a further provider loses.

    Args:
        available: The available providers.
        settings: The settings of the run.
        provided: The objects of the program.
        losers: The providers that have lost in earlier attempts; those of this attempt are added.
    """

    def __init__(
        self,
        available: AvailableProviders,
        settings: GivenSettings,
        provided: Sequence[object],
        losers: dict[Provider, tuple[Any, Provider | None]],
    ) -> None:
        self._available = available
        self._settings = settings
        self._provided = provided
        self._losers = losers
        self._by_type: dict[str, object] = {}
        self._used: dict[Provider, None] = {}
        self._problems: dict[str, str] = {}

    def assign(self, requests: Sequence[_Request], starters: Sequence[Provider]) -> bool:
        """Assign a provider to each needed type; return False as soon as a further provider loses."""
        pending = list(requests)
        for provider in starters:
            self._use(provider, (), pending)
        while pending:
            # Needed types come before optional ones. Types with a single candidate come first: it is then
            # preferred for the other types.
            needed = [each for each in pending if not each.is_optional] or pending
            single = (each for each in needed if len(self._candidates(each.type, each.chain)) <= 1)
            request = next(single, needed[0])
            pending.remove(request)
            name = full_name(request.type)
            if name in self._by_type:
                continue
            provided = self._of_program(request.type)
            if provided is not None:
                self._by_type[name] = provided
                if self._lose(self._available.of_type(name), request, None):
                    return False
                continue
            candidates = self._candidates(request.type, request.chain)
            if not candidates:
                self._problems[name] = self._explain(request)
                if request.chain and not request.is_optional:
                    raise ProviderError(self._problems[name])
                continue
            chosen = self._best(request, candidates)
            self._by_type[name] = chosen
            if self._lose([provider for provider in candidates if provider is not chosen], request, chosen):
                return False
            if chosen not in self._used:
                self._use(chosen, request.chain, pending)
        return True

    def _of_program(self, kind: Any) -> object:
        fitting = [thing for thing in self._provided if fits(thing, kind)]
        if len(set(map(id, fitting))) > 1 and len(set(map(type, fitting))) == 1:
            raise ProviderError(
                f"the program provides {len(fitting)} objects of the class {type(fitting[0]).__name__}: the "
                f"choice between them for {_with_article(kind)} would be arbitrary"
            )
        return next(iter(fitting), None)

    def _lose(self, losers: Sequence[Provider], request: _Request, winner: Provider | None) -> bool:
        """Let *losers* lose the type of a request to *winner*; return whether one had not lost before."""
        new = [provider for provider in losers if provider not in self._losers]
        self._losers |= dict.fromkeys(new, (request.type, winner))
        return bool(new)

    def result(self) -> Choice:
        self._add_clock()
        order: dict[Provider, None] = {}
        for provider in self._used:
            self._append_after_needs(provider, (), order)
        return Choice(list(order), self._by_type, self._problems, self._losers)

    def _use(self, provider: Provider, chain: tuple[Provider, ...], pending: list[_Request]) -> None:
        self._used[provider] = None
        for need in _needs(provider):
            pending.append(_Request(need.type, need.is_optional, (*chain, provider)))

    def _candidates(self, kind: Any, chain: tuple[Provider, ...] = ()) -> list[Provider]:
        """Return the providers of a type that can be used, apart from those that have lost."""
        return [
            provider
            for provider in self._available.of_type(full_name(kind))
            if provider not in self._losers
            and provider not in chain
            and self._is_usable(provider, (*chain, provider))
        ]

    def _is_usable(self, provider: Provider, chain: tuple[Provider, ...]) -> bool:
        if not _has_settings(provider, self._settings):
            return False
        return all(
            need.is_optional
            or self._of_program(need.type) is not None
            or bool(self._candidates(need.type, chain))
            for need in _needs(provider)
        )

    def _best(self, request: _Request, candidates: Sequence[Provider]) -> Provider:
        ranked = {provider: self._rank(provider) for provider in candidates}
        best = [provider for provider in candidates if ranked[provider] == max(ranked.values())]
        # One that takes the settings that make another a candidate replaces it: a bag with a robot's
        # description.
        wider = [
            provider
            for provider in best
            if all(self._required(other) <= provider.settings.keys() for other in best)
        ]
        if len(wider) == 1:
            return wider[0]
        if len(best) > 1:
            found = join_names(map(repr, best))
            raise ProviderError(
                f"{len(best)} providers provide {_with_article(request.type)}: {found}; {_path(request)}. "
                "Choose one by an option, or pass the object"
            )
        return best[0]

    def _rank(self, provider: Provider) -> "_Rank":
        needs = [self._available.of_type(full_name(need.type)) for need in _needs(provider)]
        return _Rank(
            was_required=bool(self._required(provider)),
            is_used=provider in self._used,
            is_of_user=not provider.is_installed,
            needs_only_used=bool(needs) and all(any(map(self._used.__contains__, each)) for each in needs),
            is_no_default=not provider.is_default,
        )

    def _required(self, provider: Provider) -> set[type[Settings]]:
        """Return the settings without which the provider cannot be used."""
        needed = [kind for kind, optional in provider.settings.items() if not optional]
        return {kind for kind in needed if required_option_names(kind)}

    def _add_clock(self) -> None:
        """Use a provider that provides the clock alone, if it needs only what is used, and no other is."""
        clocks = [provider for provider in self._used if provider.provides_clock]
        if len(clocks) > 1:
            names = join_names(map(repr, clocks))
            raise ProviderError(
                f"a run has one clock, but {len(clocks)} of its providers are clocks: {names}"
            )
        if clocks or not (self._used.keys() - set(self._available.core) or self._provided):
            return
        for provider in self._available.of_type(_CLOCK):
            is_alone = {full_name(kind) for kind in provider.types} == {_CLOCK}
            kinds = {full_name(need.type): need.type for need in _needs(provider)}
            found = {name: self._by_type.get(name, self._of_program(kind)) for name, kind in kinds.items()}
            if is_alone and None not in found.values():
                self._used[provider] = None
                self._by_type |= found
                return

    def _append_after_needs(
        self, provider: Provider, chain: tuple[Provider, ...], order: dict[Provider, None]
    ) -> None:
        if provider in order:
            return
        if provider in chain:
            raise ProviderError(
                f"providers need each other: {_join([*chain[chain.index(provider) :], provider])}"
            )
        needed = [self._by_type.get(full_name(need.type)) for need in _needs(provider)]
        if any(need.type is Clock for need in provider.needs):
            needed += [other for other in self._used if other.provides_clock]
        for other in needed:
            if isinstance(other, Provider):
                self._append_after_needs(other, (*chain, provider), order)
        order[provider] = None

    def _explain(self, request: _Request) -> str:
        reasons = []
        for provider in self._available.of_type(full_name(request.type)):
            if provider in self._losers:
                kind, winner = self._losers[provider]
                reasons.append(
                    f"{provider} is not used, because {_name_of(winner)} provides the {_title(kind)}"
                )
            elif provider in request.chain:
                reasons.append(f"{provider} needs itself: {_join([*request.chain, provider])}")
            elif not _has_settings(provider, self._settings):
                kinds = [kind for kind, optional in provider.settings.items() if not optional]
                kinds = [kind for kind in kinds if self._settings.find(kind) is None]
                names = [name for kind in kinds for name in required_option_names(kind)]
                reasons.append(f"{provider} is not used without {join_names(names)}")
            else:
                missing = next(
                    need
                    for need in _needs(provider)
                    if not need.is_optional and not self._candidates(need.type, (*request.chain, provider))
                )
                inner = self._explain(_Request(missing.type, False, (*request.chain, provider)))
                reasons.append(f"{provider} needs {_with_article(missing.type)}, but {inner}")
        name, title = full_name(request.type), _title(request.type)
        reasons += (
            f"{provider} provides {other}, and not {name}: the file of the class was loaded twice"
            for provider in self._available.of_user
            for other in provider.type_names
            if other != name and _title(other) == title
        )
        reason = "; ".join(reasons)
        problem = f"nothing provides {_with_article(request.type)}"
        problem = f"{problem} ({_path(request)})" if request.chain and not reasons else problem
        return f"{problem}: {reason}" if reasons else problem


def _needs(provider: Provider) -> list[Need]:
    """Return the parameters for objects of other providers."""
    return [need for need in provider.needs if need.type not in TYPES_OF_RUN and not is_settings(need.type)]


def _name_of(winner: Provider | None) -> str:
    return "the program" if winner is None else winner.name


def _with_article(kind: Any) -> str:
    return with_article(_title(kind))


def _title(kind: Any) -> str:
    return kind.rpartition(".")[2] if isinstance(kind, str) else str(getattr(kind, "__name__", kind))


def _path(request: _Request) -> str:
    """Return the sentence that says what needs the type of a request."""
    if not request.chain:
        return f"a leaf needs {_with_article(request.type)}"
    return f"{_join(request.chain)} needs {_with_article(request.type)}"


def _join(chain: Sequence[Provider]) -> str:
    return " → ".join(map(repr, chain))


def unused_settings(
    choice: Choice, available: AvailableProviders, settings: GivenSettings
) -> dict[type[Settings], str]:
    """Return the settings that were given, but that no used provider takes, with the reasons.

    Args:
        choice: The used providers.
    """
    taken = {RunSettings, *(kind for provider in choice.order for kind in provider.settings)}
    reasons = {}
    for kind in [kind for kind in settings if kind not in taken]:
        takers = [provider for provider in available.all() if kind in provider.settings]
        takers = [provider for provider in takers if not provider.settings[kind]] or takers
        lost = next((choice.losers[provider] for provider in takers if provider in choice.losers), None)
        kinds = dict.fromkeys(_with_article(provider.types[0]) for provider in takers if provider.types)
        if lost is not None:
            reasons[kind] = f"{_name_of(lost[1])} provides the {_title(lost[0])}"
        elif kinds:
            reasons[kind] = f"no leaf needs {join_names(list(kinds), 'or')}"
        elif takers:
            reasons[kind] = "it is not used"
    return reasons
