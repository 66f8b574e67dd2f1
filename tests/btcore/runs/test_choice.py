"""Which providers a run uses, in which order they are opened and closed, and the errors about them."""

import inspect
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Protocol

import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore import (
    OutputError,
    ProviderError,
    Report,
    Resources,
    Run,
    RunSettings,
    Settings,
    SettingsError,
    option,
    provider,
)
from btcore.clock import Clock, SimClock
from btcore.errors import BtcoreError
from btcore.registry.resources import full_name
from btcore.runs.available_providers import AvailableProviders
from btcore.runs.providers import Provider
from btcore.runs.run import TreelessProgram
from btcore.tree.tree import Tree

FAST = RunSettings(fast=True)


class Robot(Protocol):
    """What leaves need."""

    name: str


class Simulated:
    """A robot that satisfies the protocol."""

    def __init__(self, name: str = "simulated", clock: Clock | None = None) -> None:
        self.name = name
        self.clock = clock


class WorldMap:
    """A map that fits the simulated robot alone."""


class RealSettings(Settings):
    address: Annotated[str, option("The address.")]


class BagSettings(Settings):
    bag: Annotated[str, option("The file.")]


class WorldSettings(Settings):
    world: Annotated[str, option("The world.")] = "arena"


class OutputSettings(Settings):
    output: Annotated[str | None, option("The file.")] = None  # type: ignore[assignment]


def run_with(
    *providers: Provider,
    want: Any = (),
    settings: Any = (),
    resources: Any = (),
    installed: Sequence[Provider] = (),
) -> Run:
    """Return the run of a program that wants types; no other providers are installed."""
    source = AvailableProviders(providers, uses_installed=False)
    source.known += installed
    program = TreelessProgram("Test", lambda: False)
    run = Run(program, resources=resources, settings=[FAST, *settings], providers=source)
    return run.want(*want)


@provider(provides=(Robot,), default=True)
def simulator(settings: WorldSettings) -> Iterator[Simulated]:
    yield Simulated(settings.world)


@provider
def world_map(robot: Simulated) -> WorldMap:
    return WorldMap()


@provider(provides=(Robot,))
def real(settings: RealSettings) -> Iterator[int]:
    yield 7


@provider(provides=(Robot,))
def recorded(settings: BagSettings, described: RealSettings | None) -> str:
    return f"{settings.bag} {described}"


def test_the_default_is_used_without_an_option() -> None:
    with run_with(simulator, real, recorded, want=[Robot], settings=[WorldSettings("house")]) as run:
        assert run.find(Simulated).name == "house"  # type: ignore[union-attr]


def test_a_given_required_option_selects_its_provider_and_excludes_what_needs_the_other() -> None:
    with run_with(simulator, real, world_map, want=[Robot], settings=[RealSettings("10.0.0.7")]).want(
        WorldMap, optional=True
    ) as run:
        assert list(run.resources)[:1] == [7]
        assert run.find(WorldMap) is None
        assert run.providers.choice.rejected == {simulator: "real provides the Robot"}


def test_a_provider_that_takes_the_settings_of_another_replaces_it() -> None:
    both = [BagSettings("drive.mcap"), RealSettings("tiago")]
    with run_with(simulator, real, recorded, want=[Robot], settings=both) as run:
        assert run.resources[0] == "drive.mcap RealSettings(address='tiago')"


@provider(provides=(Robot,))
def second_real(settings: BagSettings) -> int:
    return 8


def test_two_providers_that_were_given_by_options_are_an_error_that_names_both() -> None:
    both = [BagSettings("drive.mcap"), RealSettings("tiago")]
    with pytest.raises(ProviderError) as caught:
        run_with(real, second_real, want=[Robot], settings=both).__enter__()
    for name in ("real", "second_real", Path(__file__).name, "2 providers provide a Robot"):
        assert name in str(caught.value)


class Arm:
    """A part."""


class Hand:
    """Another part."""


def test_a_provider_that_takes_more_given_settings_replaces_a_provider_whose_needs_are_used() -> None:
    @provider
    def arm() -> Arm:
        return Arm()

    @provider(provides=(Robot,))
    def real_with_arm(arm: Arm, settings: RealSettings) -> int:
        return 7

    both = [BagSettings("drive.mcap"), RealSettings("tiago")]
    with run_with(arm, real_with_arm, recorded, want=[Arm, Robot], settings=both) as run:
        assert [provider.name for provider in run.providers.choice.order] == ["arm", "recorded"]


def test_a_provider_that_needs_itself_is_shown_as_a_chain() -> None:
    @provider
    def arm(hand: Hand) -> Arm:
        return Arm()

    @provider
    def hand(arm: Arm) -> Hand:
        return Hand()

    with pytest.raises(ProviderError, match=r"arm \(.*\) needs itself: arm .* → hand .* → arm"):
        run_with(arm, hand, want=[Arm]).__enter__()


def test_a_missing_need_is_shown_as_a_chain() -> None:
    @provider
    def arm(hand: Hand) -> Arm:
        return Arm()

    with pytest.raises(ProviderError, match=r"nothing provides an Arm: arm \(.*\) needs a Hand, but nothing"):
        run_with(arm, want=[Arm]).__enter__()


def test_a_need_that_the_program_fulfils_is_not_the_missing_one() -> None:
    @provider
    def robot(arm: Arm, hand: Hand) -> Simulated:
        return Simulated()

    with pytest.raises(ProviderError, match=r"nothing provides a Simulated: robot \(.*\) needs a Hand, but"):
        run_with(robot, want=[Simulated], resources=[Arm()]).__enter__()


def test_objects_of_the_program_win_over_providers() -> None:
    own = Simulated("own")
    with run_with(simulator, world_map, want=[Simulated, WorldMap], resources=[own]) as run:
        assert run.find(Simulated) is own
        assert run.find(WorldMap) is not None


def test_the_provider_of_more_of_the_needed_types_is_preferred() -> None:
    class Both(NamedTuple):
        kind: str

    @provider(provides=(Arm, Hand), default=True)
    def both() -> Both:
        return Both("both")

    @provider
    def arm() -> Arm:
        raise AssertionError("not used")

    with run_with(arm, both, want=[Arm, Hand]) as run:
        assert run.resources[0] == Both("both")


def test_several_objects_are_found_by_their_types() -> None:
    @provider
    def body() -> Iterator[tuple[Arm, Hand]]:
        yield Arm(), Hand()

    with run_with(body, want=[Hand, Arm]) as run:
        assert isinstance(run.find(Hand), Hand)
        assert isinstance(run.find(Arm), Arm)


def test_the_clock_of_a_used_provider_is_that_of_the_run() -> None:
    clock = SimClock()

    @provider(provides=(Robot, Clock))
    def robot() -> Simulated:
        return Simulated(clock=clock)

    seen = []

    @provider
    def hand(now: Clock) -> Hand:
        seen.append(now)
        return Hand()

    with run_with(robot, hand, want=[Hand, Robot]) as run:
        assert run.clock is clock
        assert run.tree.clock is clock
        assert seen == [clock]


def test_two_clocks_are_an_error() -> None:
    @provider(provides=(Clock,))
    def arm() -> Arm:
        return Arm()

    @provider(provides=(Clock,))
    def hand() -> Hand:
        return Hand()

    with pytest.raises(ProviderError, match=r"one clock, but 2 of its providers are clocks: arm .* and hand"):
        run_with(arm, hand, want=[Arm, Hand]).__enter__()


def test_a_clock_alone_is_used_only_beside_what_it_needs() -> None:
    clock = SimClock()

    @provider
    def arm() -> Arm:
        return Arm()

    @provider
    def arm_clock(arm: Arm) -> Clock:
        return clock

    with run_with(arm, arm_clock, want=[Arm]) as run:
        assert run.clock is clock
    with run_with(arm, arm_clock) as run:
        assert run.clock is not clock


# --- side-effect providers, errors, the tree


def test_a_side_effect_provider_is_used_if_a_setting_was_given() -> None:
    opened = []

    @provider
    def output(settings: OutputSettings, tree: Tree, resources: Resources, report: Report) -> Iterator[None]:
        opened.append((settings.output, tree.id))
        yield
        report.add("output", {"file": settings.output})

    with run_with(output) as run:
        pass
    assert run.report == {}
    with run_with(output, settings=[OutputSettings("a.txt")]) as run:
        run.tick_to_end()
    assert opened == [("a.txt", "TestAlone")]
    assert run.report == {"output": {"file": "a.txt"}}

    @provider
    def useless() -> None:
        pass

    with pytest.raises(ProviderError, match=r"useless .* no settings, so that no run would use it"):
        run_with(useless).__enter__()


@pytest.mark.parametrize("follows", [True, False])
def test_a_new_tree_is_passed_on_or_the_provider_is_opened_again(follows: bool) -> None:
    log = []

    class Follower:
        def replace_tree(self, tree: Tree) -> None:
            log.append(f"follow {tree.id}")

    @provider
    def output(settings: OutputSettings, tree: Tree) -> Iterator[object]:
        log.append(f"open {tree.id}")
        yield Follower() if follows else None
        log.append("close")

    with run_with(output, settings=[OutputSettings("a.txt")]) as run:
        run.replace_tree(TreelessProgram("Next").create_tree(run.clock))
    reopened = ["follow NextAlone"] if follows else ["close", "open NextAlone"]
    assert log == ["open TestAlone", *reopened, "close"]


def test_a_provider_that_raises_is_named_with_its_line_and_the_others_are_closed() -> None:
    closed = []

    @provider
    def arm() -> Iterator[Arm]:
        yield Arm()
        closed.append("arm")

    @provider
    def hand(arm: Arm) -> Iterator[Hand]:
        raise ValueError("no power")
        yield Hand()

    with pytest.raises(
        ProviderError, match=r"the provider hand \(.*\) raised ValueError at .*test_choice.py:\d+: no"
    ):
        run_with(arm, hand, want=[Hand]).__enter__()
    assert closed == []  # as with contextlib.contextmanager, the exception was raised at its yield


def test_an_incomplete_output_is_passed_on() -> None:
    @provider
    def hand() -> Iterator[Hand]:
        yield Hand()
        raise OutputError("disk full")

    with pytest.raises(OutputError, match="disk full"), run_with(hand, want=[Hand]):
        pass


def test_an_exception_of_the_run_reaches_the_providers_and_stays_itself() -> None:
    seen = []

    @provider
    def arm(report: Report) -> Iterator[Arm]:
        try:
            yield Arm()
        finally:
            seen.append(report.end_reason)

    with pytest.raises(KeyError), run_with(arm, want=[Arm]):
        raise KeyError("x")
    assert seen == ["program_error"]


def test_a_provider_without_types_is_explained() -> None:
    @provider
    def arm(hand) -> Arm:  # type: ignore[no-untyped-def]
        return Arm()

    with pytest.raises(ProviderError, match=r"the parameter 'hand' of the provider arm .* has no type"):
        run_with(arm, want=[Arm]).__enter__()


def test_annotations_give_full_names_of_types_that_are_not_imported() -> None:
    @provider
    def arm(
        hand: "grippers.hand.Hand | None",  # type: ignore[name-defined]  # noqa: F821
        clock: "Clock",
    ) -> "Iterator[tuple[grippers.arm.Arm, Simulated]]":  # type: ignore[name-defined]  # noqa: F821
        yield None, Simulated()

    assert [(need.type, need.is_optional) for need in arm.needs] == [
        ("grippers.hand.Hand", True),
        (Clock, False),
    ]
    assert arm.types == ("grippers.arm.Arm", Simulated)

    @provider
    def leg() -> "Iterator[Leg]":  # type: ignore[name-defined]  # noqa: F821
        yield None

    with pytest.raises(
        ProviderError, match=r"leg .* cannot be read: name 'Leg' is not defined; write the full"
    ):
        _ = leg.types


# --- random sets of providers

TYPES = [type(f"T{number}", (), {}) for number in range(6)]


class Plan(NamedTuple):
    """A random provider: indices of types, and what it does."""

    provides: list[int]
    needs: list[tuple[int, bool]]
    raises: str
    is_default: bool
    is_installed: bool


plans = st.builds(
    Plan,
    st.lists(st.integers(0, 5), min_size=1, max_size=2, unique=True),
    st.lists(st.tuples(st.integers(0, 5), st.booleans()), max_size=3, unique_by=lambda need: need[0]),
    st.sampled_from(["", "", "", "before", "after", "output"]),
    st.booleans(),
    st.booleans(),
)


def make_provider(number: int, plan: Plan, log: list[tuple[str, int]]) -> Provider:
    """Return a provider that does as planned, and logs when it is opened and closed."""

    def function(**arguments: object) -> Iterator[object]:
        for index, is_optional in plan.needs:
            value = arguments[f"t{index}"]
            assert isinstance(value, TYPES[index]) or (is_optional and value is None)
        if plan.raises == "before":
            raise ValueError("before")
        log.append(("open", number))
        try:
            yield type("Made", tuple(TYPES[index] for index in plan.provides), {})()
        finally:
            log.append(("close", number))
        if plan.raises == "after":
            raise ValueError("after")
        if plan.raises == "output":
            raise OutputError("output")

    hints: dict[str, Any] = {
        f"t{index}": TYPES[index] | None if is_optional else TYPES[index] for index, is_optional in plan.needs
    }
    function.__annotations__ = {**hints, "return": Iterator[TYPES[plan.provides[0]]]}  # type: ignore[valid-type]
    parameters = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY) for name in hints]
    function.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return Provider(function, [TYPES[index] for index in plan.provides[1:]], plan.is_default)


@given(st.lists(plans, max_size=6), st.lists(st.integers(0, 5), unique=True), st.sampled_from(["", "body"]))
def test_random_providers_open_after_their_needs_and_close_in_reverse(
    chosen: list[Plan], wanted: list[int], raises: str
) -> None:
    log: list[tuple[str, int]] = []
    made = [make_provider(number, plan, log) for number, plan in enumerate(chosen)]
    installed = [made[number] for number, plan in enumerate(chosen) if plan.is_installed]
    users = [provider for provider in made if provider not in installed]
    with (
        suppress(BtcoreError, KeyError),
        run_with(*users, installed=installed).want(*(TYPES[index] for index in wanted), optional=True) as run,
    ):
        for index in wanted:
            found = run.find(TYPES[index])
            assert found is None or isinstance(found, TYPES[index])
            if found is None:  # only if there is a reason
                assert run.providers.choice.sources[full_name(TYPES[index])].problem
        if raises:
            raise KeyError("body")
    opened = [number for action, number in log if action == "open"]
    closed = [number for action, number in log if action == "close"]
    assert len(set(opened)) == len(opened)
    assert closed == opened[::-1]
    assert log == [("open", number) for number in opened] + [("close", number) for number in closed]


def test_an_installed_provider_comes_before_the_default_of_the_core() -> None:
    @provider(provides=("random.Random",))
    def dice() -> object:
        return "dice"

    with run_with(want=["random.Random"], installed=[dice]) as run:
        assert run.resources == ["dice"]


def test_a_provider_of_the_user_comes_before_an_installed_one() -> None:
    own = Arm()

    @provider
    def own_arm() -> Arm:
        return own

    @provider
    def installed_arm() -> Arm:
        return Arm()

    with run_with(own_arm, want=[Arm], installed=[installed_arm]) as run:
        assert run.resources == [own]


def test_a_provider_with_the_tree_is_used_for_its_settings_alone() -> None:
    class Watcher(NamedTuple):
        tree: str

    @provider
    def watcher(settings: OutputSettings, tree: Tree) -> Iterator[Watcher]:
        log.append(f"open {tree.id}")
        yield Watcher(tree.id)

    log: list[str] = []
    with run_with(watcher, settings=[OutputSettings("a.txt")]).want(Watcher, optional=True) as run:
        assert run.find(Watcher) is None
    assert log == ["open TestAlone"]


def test_a_rejected_provider_rejects_no_other() -> None:
    @provider(provides=(Robot,))
    def own() -> tuple[Simulated, WorldMap]:
        raise AssertionError("not used")

    @provider
    def drawn_map() -> WorldMap:
        return WorldMap()

    settings = [RealSettings("10.0.0.7")]
    with run_with(own, want=[WorldMap, Robot], settings=settings, installed=[drawn_map, real]) as run:
        assert [provider.name for provider in run.providers.choice.order] == ["drawn_map", "real"]


def test_a_preferred_provider_without_what_it_needs_is_an_error() -> None:
    @provider(provides=(Robot,))
    def own(arm: Arm) -> Simulated:
        return Simulated()

    with pytest.raises(ProviderError) as caught:
        run_with(own, want=[Robot], installed=[simulator]).__enter__()
    assert str(caught.value) == (
        f"nothing provides a Robot: {own} needs an Arm, but nothing provides an Arm; "
        f"{simulator} is not used, because own provides the Robot"
    )


def test_what_the_clock_needs_cannot_need_the_clock() -> None:
    @provider
    def arm(clock: Clock) -> Arm:
        return Arm()

    @provider(provides=(Clock,))
    def hand(arm: Arm) -> Hand:
        return Hand()

    with pytest.raises(ProviderError, match=r"the clock .* is needed to open its own provider, hand"):
        run_with(arm, hand, want=[Hand]).__enter__()


def test_what_is_none_cannot_be_needed() -> None:
    class Bell:
        pass

    @provider
    def gong() -> Bell | None:
        return None

    @provider
    def clapper(settings: OutputSettings, bell: Bell) -> None:
        pass

    with pytest.raises(ProviderError, match=r"clapper .* needs its 'bell', but gong .* has provided None"):
        run_with(gong, clapper, settings=[OutputSettings("a.txt")]).__enter__()


def test_two_objects_of_a_class_are_ambiguous() -> None:
    class Bell:
        pass

    @provider
    def clapper(settings: OutputSettings, bell: Bell) -> None:
        pass

    with pytest.raises(ProviderError, match="2 resources of the class Bell fit the type Bell"):
        run_with(clapper, settings=[OutputSettings("a.txt")], resources=[Bell(), Bell()]).__enter__()


def test_mistakes_of_programs_are_explained() -> None:
    def plain() -> None:
        pass

    async def late() -> None:
        pass

    with pytest.raises(TypeError, match=r"plain is not a provider: mark the function by @btcore\.provider"):
        run_with(plain)  # type: ignore[arg-type]
    with pytest.raises(ProviderError, match="the provider late is asynchronous"):
        provider(late)
    with pytest.raises(SettingsError, match="OutputSettings are given 2 times"):
        run_with(settings=[OutputSettings("a"), OutputSettings("b")])
    with pytest.raises(TypeError, match="there is no run of a Tree: write the XML to a file"):
        Run(TreelessProgram("Other").create_tree(SimClock()))  # type: ignore[arg-type]
