"""Words for people."""

import pytest

from toolkit.core.text import join_words


@pytest.mark.parametrize(
    ("words", "listed"), [([], ""), (["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c")]
)
def test_words_are_listed_as_in_a_sentence(words, listed):
    assert join_words(words) == join_words(dict.fromkeys(words)) == listed


def test_the_last_word_may_be_an_alternative():
    assert join_words(iter("abc"), "or") == "a, b or c"
