"""Past-time temporal logic over the steps of a driver who is examined."""

import warnings

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.reports.exam import examinee

CONDITIONS = st.lists(st.booleans(), max_size=30)


def flags(values):
    return np.array(values, np.bool_)


@given(CONDITIONS, st.one_of(st.none(), st.integers(0, 40)))
def test_once_and_historically_look_back_as_far_as_they_are_told(values, within):
    holds = flags(values)
    begins = [0 if within is None else max(k - within, 0) for k in range(len(values))]
    assert examinee.once(holds, within).tolist() == [any(values[b : k + 1]) for k, b in enumerate(begins)]
    assert examinee.historically(holds, within).tolist() == [all(values[b : k + 1]) for k, b in enumerate(begins)]


@given(st.lists(st.tuples(st.booleans(), st.booleans()), max_size=30))
def test_since_needs_a_begin_and_what_holds_ever_since(pairs):
    holds, begin = flags([pair[0] for pair in pairs]), flags([pair[1] for pair in pairs])
    expected = [
        any(pairs[j][1] and all(pairs[i][0] for i in range(j + 1, k + 1)) for j in range(k + 1))
        for k in range(len(pairs))
    ]
    assert examinee.since(holds, begin).tolist() == expected


@given(CONDITIONS, st.integers(0, 10))
def test_held_for_needs_all_the_steps_and_a_condition_rises_where_it_did_not_hold_before(values, steps):
    expected = [k >= steps and all(values[k - steps : k + 1]) for k in range(len(values))]
    assert examinee.held_for(flags(values), steps).tolist() == expected
    assert examinee.rises(flags(values)).tolist() == [
        value and not (k and values[k - 1]) for k, value in enumerate(values)
    ]


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=2, max_size=15))
@settings(max_examples=15, deadline=None)
def test_the_operators_agree_with_rtamt(pairs):
    """RTAMT evaluates the same formulas as robustness, whose sign says whether they hold."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of the parser that it is made with
        import rtamt

    first, second = ([float(value) for value in column] for column in zip(*pairs, strict=True))
    holds, begin = flags(first), flags(second)
    ours = {
        "once (a >= 0.5)": examinee.once(holds),
        "once[0:3] (a >= 0.5)": examinee.once(holds, 3),
        "historically (a >= 0.5)": examinee.historically(holds),
        "historically[0:3] (a >= 0.5)": examinee.historically(holds, 3),
        "(a >= 0.5) since (b >= 0.5)": examinee.since(holds, begin),
    }
    for formula, values in ours.items():
        oracle = rtamt.StlDiscreteTimeSpecification()
        for name in ("a", "b", "out"):
            oracle.declare_var(name, "float")
        oracle.spec = f"out = {formula}"
        oracle.parse()
        robustness = oracle.evaluate({"time": list(range(len(pairs))), "a": first, "b": second})
        assert [value > 0.0 for _, value in robustness] == values.tolist(), formula
