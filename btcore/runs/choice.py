"""Choosing the providers of a run: which are used, and in which order they are opened.

A provider of a type is used if a leaf or a used provider needs the type, a provider of nothing if one of its
settings was given. If several provide a type, the order of preference is: a provider whose required option
was given; one that is used for another type anyway; the user's; an installed one; one that is marked as
default. A provider that lost a type is not used for any other type, and neither is a provider that needs what
only a loser provides: the map of a simulated world does not fit another robot.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

from btcore.clock import Clock
from btcore.runs.providers import (
    Need,
    Provider,
    ProviderError,
    ProviderSource,
    Report,
    Resources,
    full_name,
    is_settings,
)
from btcore.runs.settings import (
    RunSettings,
    Settings,
    create_options,
    given_fields,
    has_required_fields,
    option_names,
)
from btcore.suggestions import join_names
from btcore.tree.tree import Tree

S = TypeVar("S", bound=Settings)

_CLOCK = full_name(Clock)
_OF_THE_RUN = (Clock, Tree, Report, Resources)
"""Types of parameters that every run has."""


class ChosenSettings(dict[type[Settings], Settings]):
    """The settings of a run by their classes. A class that is missing has its defaults."""

    def __init__(self, settings: Iterable[Settings] = ()) -> None:
        super().__init__((type(one), one) for one in settings)

    def find(self, kind: type[S]) -> S | None:
        """Return the settings of the class *kind*; None if a required one was not given."""
        found = self.get(kind)
        if found is None and not has_required_fields(kind):
            found = kind()
        return found  # type: ignore[return-value]

    def are_given(self, kind: type[Settings]) -> bool:
        """Return whether a value other than the default was given."""
        return kind in self and bool(given_fields(self[kind]))


class Choice(NamedTuple):
    """The used providers.

    Attributes:
        order: The providers in the order in which they are opened.
        sources: What is provided for each needed type, by its full name: a provider, or an object of the
            program.
        problems: Why nothing is provided for a type, by its full name.
        losers: The providers that were not chosen, with the type and the provider that was chosen, or None if
            the program has an object of the type.
    """

    order: list[Provider]
    sources: Mapping[str, object]
    problems: Mapping[str, str]
    losers: Mapping[Provider, tuple[Any, Provider | None]]

    @property
    def clock(self) -> Provider | None:
        """The provider of the run's clock, or None."""
        return next((one for one in self.order if one.provides_clock), None)


def choose(
    wanted: Sequence[Any],
    source: ProviderSource,
    settings: ChosenSettings,
    objects: Sequence[object] = (),
    optional: Sequence[Any] = (),
) -> Choice:
    """Return the providers of a run.

    Args:
        wanted: The types that the leaves of the tree need.
        source: The available providers.
        settings: The settings of the run.
        objects: Objects of the program, which are preferred to providers.
        optional: Types that the program can do without. A provider that is used for one of them alone is not
            preferred for the types that are needed.

    Raises:
        ProviderError: Two providers are equally good, or need each other, or a provider of nothing needs what
            nothing provides.
    """
    starters = []
    if settings.keys() - {RunSettings}:  # loading these providers takes time
        for one in source.of_nothing():
            if any(settings.are_given(kind) for kind, _ in one.settings) and _has_settings(one, settings):
                starters.append(one)
    chooser = _Chooser(source, settings, objects)
    requests = [
        *(_Request(kind, False, ()) for kind in wanted),
        *(_Request(kind, True, ()) for kind in optional),
    ]
    while chooser.assign(requests, starters):
        pass
    return chooser.result()


def _has_settings(one: Provider, settings: ChosenSettings) -> bool:
    return all(optional or settings.find(kind) is not None for kind, optional in one.settings)


class _Request(NamedTuple):
    """A needed type, and the providers that lead to it from a leaf or from a provider of nothing."""

    type: Any
    is_optional: bool
    chain: tuple[Provider, ...]


class _Chooser:
    def __init__(self, source: ProviderSource, settings: ChosenSettings, objects: Sequence[object]) -> None:
        self._source = source
        self._settings = settings
        self._objects = objects
        self._losers: dict[Provider, tuple[Any, Provider | None]] = {}

    def assign(self, requests: Sequence[_Request], starters: Sequence[Provider]) -> bool:
        """Assign a provider to each needed type; return whether to repeat it, because one has lost."""
        self._sources: dict[str, object] = {}
        self._used: dict[Provider, None] = {}
        self._problems: dict[str, str] = {}
        pending = list(requests)
        for one in starters:
            self._use(one, (), pending)
        while pending:
            # Needed types come before optional ones. Types with a single candidate come first: it is then
            # preferred for the other types.
            needed = [one for one in pending if not one.is_optional] or pending
            single = (one for one in needed if len(self._candidates(one.type, one.chain)) <= 1)
            request = next(single, needed[0])
            pending.remove(request)
            name = full_name(request.type)
            if name in self._sources:
                continue
            owned = [one for one in self._objects if _names_of(one, request.type)]
            if owned:
                self._sources[name] = owned[0]
                if self._lose(self._source.of_type(name), request, None):
                    return True
                continue
            candidates = self._candidates(request.type, request.chain)
            if not candidates:
                self._problems[name] = self._explain(request)
                if request.chain and not request.is_optional:
                    raise ProviderError(self._problems[name])
                continue
            chosen = self._best(request, candidates)
            self._sources[name] = chosen
            if self._lose([one for one in candidates if one is not chosen], request, chosen):
                return True
            if chosen not in self._used:
                self._use(chosen, request.chain, pending)
        return False

    def _lose(self, losers: Sequence[Provider], request: _Request, winner: Provider | None) -> bool:
        """Let *losers* lose the type of a request to *winner*; return whether one had not lost before."""
        new = [one for one in losers if one not in self._losers]
        self._losers |= dict.fromkeys(new, (request.type, winner))
        return bool(new)

    def result(self) -> Choice:
        self._add_clock()
        order: dict[Provider, None] = {}
        for one in self._used:
            self._open_after_needs(one, (), order)
        late = [one for one in order if one.follows_tree]
        return Choice(
            [*(one for one in order if one not in late), *late], self._sources, self._problems, self._losers
        )

    def _use(self, one: Provider, chain: tuple[Provider, ...], pending: list[_Request]) -> None:
        self._used[one] = None
        for need in _needs(one):
            pending.append(_Request(need.type, need.is_optional, (*chain, one)))

    def _candidates(self, kind: Any, chain: tuple[Provider, ...] = ()) -> list[Provider]:
        """Return the providers of a type that can be used, apart from those that have lost."""
        return [
            one
            for one in self._source.of_type(full_name(kind))
            if one not in self._losers and one not in chain and self._is_usable(one, (*chain, one))
        ]

    def _is_usable(self, one: Provider, chain: tuple[Provider, ...]) -> bool:
        if not _has_settings(one, self._settings):
            return False
        return all(
            need.is_optional
            or any(_names_of(owned, need.type) for owned in self._objects)
            or bool(self._candidates(need.type, chain))
            for need in _needs(one)
        )

    def _best(self, request: _Request, candidates: Sequence[Provider]) -> Provider:
        ranked = {one: self._rank(one) for one in candidates}
        best = [one for one in candidates if ranked[one] == max(ranked.values())]
        # One that takes the settings that make another a candidate replaces it: a bag with a robot's
        # description.
        wider = [
            one
            for one in best
            if all(self._required(other) <= {kind for kind, _ in one.settings} for other in best)
        ]
        if len(wider) == 1:
            return wider[0]
        if len(best) > 1:
            found = join_names([f"{one.name} ({one.place})" for one in best])
            raise ProviderError(
                f"{len(best)} providers provide a {_title(request.type)}: {found}; {_path(request)}. "
                "Choose one by an option, or pass the object"
            )
        return best[0]

    def _rank(self, one: Provider) -> tuple[bool, bool, bool, bool]:
        return bool(self._required(one)), one in self._used, not one.is_installed, not one.is_default

    def _required(self, one: Provider) -> set[type[Settings]]:
        """Return the settings without which the provider cannot be used."""
        return {kind for kind, optional in one.settings if not optional and has_required_fields(kind)}

    def _add_clock(self) -> None:
        """Use a provider that provides the clock alone, if it needs only what is used, and no other is."""
        clocks = [one for one in self._used if one.provides_clock]
        if len(clocks) > 1:
            found = join_names([f"{one.name} ({one.place})" for one in clocks])
            raise ProviderError(
                f"a run has one clock, but {len(clocks)} of its providers are clocks: {found}"
            )
        if clocks or not (self._used or self._objects):
            return
        for one in self._source.of_type(_CLOCK):
            is_alone = {full_name(kind) for kind in one.types} == {_CLOCK}
            names = [full_name(need.type) for need in _needs(one)]
            if is_alone and all(
                name in self._sources or any(_names_of(owned, need.type) for owned in self._objects)
                for name, need in zip(names, _needs(one), strict=True)
            ):
                self._used[one] = None
                for name, need in zip(names, _needs(one), strict=True):
                    owned = [each for each in self._objects if _names_of(each, need.type)]
                    self._sources.setdefault(name, owned[0] if owned else None)
                return

    def _open_after_needs(
        self, one: Provider, chain: tuple[Provider, ...], order: dict[Provider, None]
    ) -> None:
        if one in order:
            return
        if one in chain:
            raise ProviderError(f"providers need each other: {_join([*chain[chain.index(one) :], one])}")
        needed = [self._sources.get(full_name(need.type)) for need in _needs(one)]
        if any(need.type is Clock for need in one.needs):
            needed += [other for other in self._used if other.provides_clock]
        for other in needed:
            if isinstance(other, Provider):
                self._open_after_needs(other, (*chain, one), order)
        order[one] = None

    def _explain(self, request: _Request) -> str:
        """Return why nothing provides the type of a request."""
        reasons = []
        for one in self._source.of_type(full_name(request.type)):
            if one in self._losers:
                kind, winner = self._losers[one]
                reasons.append(f"{one} is not used, because {_name_of(winner)} provides the {_title(kind)}")
            elif one in request.chain:
                reasons.append(f"{one} needs itself: {_join([*request.chain, one])}")
            elif not _has_settings(one, self._settings):
                reasons.append(f"{one} is not used without {_required_options(one, self._settings)}")
            else:
                missing = next(
                    need
                    for need in _needs(one)
                    if not need.is_optional and not self._candidates(need.type, (*request.chain, one))
                )
                inner = self._explain(_Request(missing.type, False, (*request.chain, one)))
                reasons.append(f"{one} needs a {_title(missing.type)}, but {inner}")
        reason = "; ".join(reasons)
        told = f"nothing provides a {_title(request.type)}"
        told = f"{told} ({_path(request)})" if request.chain and not reasons else told
        return f"{told}: {reason}" if reasons else told


def _needs(one: Provider) -> list[Need]:
    """Return the parameters for objects of other providers."""
    return [need for need in one.needs if need.type not in _OF_THE_RUN and not is_settings(need.type)]


def _names_of(thing: object, kind: Any) -> bool:
    """Return whether an object of the program fits a type, which may be a stand-in."""
    if any(full_name(base) == full_name(kind) for base in type(thing).__mro__):
        return True
    try:
        return isinstance(thing, kind) and bool(getattr(kind, "_is_protocol", False))
    except TypeError:
        return False


def _name_of(winner: Provider | None) -> str:
    return "the program" if winner is None else winner.name


def _title(kind: Any) -> str:
    return kind.rpartition(".")[2] if isinstance(kind, str) else str(getattr(kind, "__name__", kind))


def _path(request: _Request) -> str:
    """Return who needs the type of a request."""
    if not request.chain:
        return f"a leaf needs a {_title(request.type)}"
    return f"{_join(request.chain)} needs a {_title(request.type)}"


def _join(chain: Sequence[Provider]) -> str:
    return " → ".join(map(repr, chain))


def _required_options(one: Provider, settings: ChosenSettings) -> str:
    names = [
        item.opts[0]
        for kind, optional in one.settings
        if not optional and settings.find(kind) is None
        for item in create_options(kind)
        if item.is_needed
    ]
    return join_names(names)


def explain_unused(
    choice: Choice, source: ProviderSource, settings: ChosenSettings, used: Iterable[type[Settings]] = ()
) -> list[str]:
    """Return a sentence for each class of settings that was given, but that no used provider takes.

    Args:
        used: Classes of settings that the program uses itself.
    """
    taken = {kind for one in choice.order for kind, _ in one.settings} | set(used)
    unused = [kind for kind in settings if settings.are_given(kind) and kind not in taken]
    sentences = []
    for kind in unused:
        takers = [one for one in source.all() if any(each is kind for each, _ in one.settings)]
        takers = [one for one in takers if (kind, False) in one.settings] or takers
        if not takers:
            continue
        names = list(option_names(settings[kind]))
        lost = next((choice.losers[one] for one in takers if one in choice.losers), None)
        if lost is not None:
            reason = f"{_name_of(lost[1])} provides the {_title(lost[0])}"
        else:
            kinds = dict.fromkeys(_title(one.types[0]) for one in takers if one.types)
            reason = f"no leaf needs a {join_names(list(kinds), 'or')}" if kinds else "it is not used"
        have = "has" if len(names) == 1 else "have"
        sentences.append(f"{join_names(names)} {have} no effect: {reason}")
    return sentences
