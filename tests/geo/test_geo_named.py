import string

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from sweeps import sweep

from geo.errors import WbfMissionError
from geo.named import ParameterError, check_parameters, format_named, parse_named, split_named

SCALARS = st.one_of(
    st.booleans(),
    st.none(),
    st.integers(-(10**17), 10**17),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(string.printable.replace('"', ""), max_size=12),
)
PARAMETERS = st.dictionaries(
    st.from_regex(r"[a-z_][a-z0-9_]{0,9}", fullmatch=True), st.one_of(SCALARS, st.lists(SCALARS).map(tuple))
)


@sweep(few=40, many=200)
@given(PARAMETERS)
@example({"a": "None", "b": "", "c": "-", "d": "1", "e": "a,b]", "f": ("true", None), "g": 1e300})
def test_what_is_written_is_read_back(parameters):
    text = format_named("gp", parameters)
    assert repr(parse_named(text)) == repr(("gp", parameters))
    assert format_named(*parse_named(text)) == text


@sweep(few=20, many=200)
@given(st.lists(st.tuples(st.sampled_from(["gp", "point", "disk"]), PARAMETERS), min_size=1, max_size=4))
def test_several_names_in_one_text_are_cut_apart(named):
    texts = [format_named(*one) for one in named]
    assert split_named(", ".join(texts)) == texts


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("lawnmower:direction=0.3,x=1", ("lawnmower", {"direction": 0.3, "x": 1})),
        ("  Spiral ", ("Spiral", {})),
        ("a:direction=longest side", ("a", {"direction": "longest side"})),
        ("a:file=C:/data=1.bin", ("a", {"file": "C:/data=1.bin"})),
        ("a:b=None,c=TRUE,d=.5,e=-1E3", ("a", {"b": None, "c": True, "d": 0.5, "e": -1000.0})),
        ("a:b=[],c=[none,1]", ("a", {"b": (), "c": (None, 1)})),
        ("a:b=1.2.3,c=12ab,d=nan,e=inf", ("a", {"b": "1.2.3", "c": "12ab", "d": "nan", "e": "inf"})),
    ],
)
def test_what_is_read(text, expected):
    assert parse_named(text) == expected


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "without a name"),
        (":a=1", "without a name"),
        ("spiral:", "not key=value"),
        ("spiral:a", "not key=value"),
        ("spiral:1a=1", "not key=value"),
        ("spiral:a=", "a has no value"),
        ("spiral:a=[1,,2]", "a has no value"),
        ("spiral:a=1,a=2", "a is given twice"),
        ("spiral:a=[1,2", "brackets"),
        ("spiral:a=1]", "brackets"),
        ("spiral:a=[1]2", "has text after"),
        ("spiral:a=1[2]", "more than one value"),
        ('spiral:a="b', "not closed"),
        ('spiral:a="b"c', "more than one value"),
        ("spiral:a=1e999", "too large"),
    ],
)
def test_what_is_refused(text, says):
    with pytest.raises(ParameterError, match=says) as caught:
        parse_named(text)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, WbfMissionError)


@given(st.text(max_size=30))
def test_any_text_is_read_or_refused_in_one_line(text):
    try:
        parse_named(text)
    except ParameterError as error:
        assert len(str(error).splitlines()) == 1


def test_unknown_parameters_are_refused_with_the_known_ones():
    check_parameters("planner spiral", ["inset"], ["inset", "turns"])
    with pytest.raises(ParameterError) as caught:
        check_parameters("planner spiral", ["insets"], ["turns", "inset"])
    assert (
        str(caught.value)
        == "planner spiral: unknown parameter 'insets' (is 'inset' meant?): choose inset, turns"
    )
    with pytest.raises(ParameterError, match="unknown parameter 'b': there is none"):
        check_parameters("planner x", ["c", "b"], [])
