"""Outcomes are read by people, too."""

import pytest

from mission.outcome import _WORDS, Outcome, in_words


@pytest.mark.parametrize("outcome", Outcome)
def test_outcomes_are_words_for_people(outcome: Outcome) -> None:
    words = in_words(outcome, "why")
    assert words.endswith(": why")
    assert "_" not in words
    assert in_words(outcome.value) == in_words(outcome)


@pytest.mark.parametrize("outcome", Outcome)
def test_a_reason_that_says_no_more_is_not_said_twice(outcome: Outcome) -> None:
    for reason in ("", outcome.value.replace("_", " "), in_words(outcome)):
        assert in_words(outcome, reason) == in_words(outcome)


def test_each_is_told_apart_and_nothing_else_is_in_the_table() -> None:
    assert len({in_words(outcome) for outcome in Outcome}) == len(Outcome)
    assert set(_WORDS) <= {outcome.value for outcome in Outcome}
