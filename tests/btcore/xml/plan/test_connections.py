"""The connections of a SubTree element are those of the blackboards that loading creates."""

from hypothesis import given
from hypothesis import strategies as st

from btcore import Registry
from btcore.lint.dry_run import DryRun
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_text

KEYS = ("a", "b", "c", "_d", "@a")
TEXTS = ("a", "{a}", "{b}", "{=}", "=", " {c} ", "${a}", "3", "{_d}", "{@b}")
ATTRIBUTES = st.dictionaries(st.sampled_from(KEYS[:3]), st.sampled_from(TEXTS))
BODY = '<BehaviorTree ID="Inner"><AlwaysSuccess/></BehaviorTree>'


@given(
    ATTRIBUTES,
    ATTRIBUTES,
    st.sampled_from(("", '_autoremap="true"', '_autoremap="no"')),
    st.sampled_from(("SubTree", "SubTreePlus")),
    st.sampled_from(("", '__autoremap="1"', '__shared_blackboard="true"')),
    st.sampled_from((3, 4)),
)
def test_the_outer_key_has_the_entry_of_the_inner_key(
    written: dict[str, str], defaults: dict[str, str], flag_4: str, tag: str, flag_3: str, format: int
) -> None:
    attributes = " ".join(f'{key}="{text}"' for key, text in written.items())
    call = f'<SubTree ID="Inner" {attributes} {flag_4}/>'
    if format == 3:
        call = f'<{tag} ID="Inner" {flag_3} {attributes}/>'
    model = "".join(f'<input_port name="{key}" default="{text}"/>' for key, text in defaults.items())
    plans = plan_document(
        parse_text(
            f'<root BTCPP_format="{format}" main_tree_to_execute="Main"><BehaviorTree ID="Main">{call}'
            f'</BehaviorTree>{BODY}<TreeNodesModel><SubTree ID="Inner">{model}</SubTree></TreeNodesModel>'
            "</root>"
        ),
        Registry.standard(),
    )
    assert plans.main_tree is not None
    [connections] = plans.main_tree.calls
    for key in KEYS:
        dry_run = DryRun(plans, plans.main_tree)
        outer, inner = (draft.subtree.blackboard for draft in dry_run.drafts)
        entry = inner.declare(key)
        outer_key = connections.outer_key(key)
        if outer_key is not None:
            assert outer.find(outer_key) is entry, (key, outer_key)
        elif not (format == 4 and key.startswith("@")):
            assert entry not in outer.local_entries().values(), key
