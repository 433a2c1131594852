"""The words of the pages: the field's words, one for each thing, in place of those that a reader must decode."""

import re

import pytest
from pages import FENCE, PAGES, read_page

WORDS = {
    r"\bright (?:on|in) \d|\b(?:is|are) right (?:on|in|at)\b": "correct",
    r"\bbare\b": "without a booster, unmodified",
    r"\b(?:never|none) saw\b": "unseen network, not used in training",
    r"\bcarr(?:y|ies|ied) over\b": "transfer to",
    r"\bin (?:clear|the other) air\b": "in clear conditions, in fog",
    r"\bfrom (?:near|afar)\b": "close-up, far away, at twice the distance",
    r"\bdo(?:es)? not lie\b(?! flat)": "does not fit flat",
    r"\b(?:goes|go|went) on where\b|\b(?:run|film|command)s? go(?:es)? on\b": "resume",
    r"\bof the kit\b": "built-in, third-party",
    r"\bof (?:your|our|its|their) own\b": "your own",
    r"\bnothing that is shown\b|\b(?:that|this|it|change|gain) is not shown\b": "no significant change",
    r"\b(?:frames|pictures|images|steps|samples) an? (?:second|step|pixel)\b": "per second, per step",
    r"\bwith(?:out a| no) network\b": "without an internet connection",
    r"\banew\b": "again",
    r"\b(?:page|report|record|table|file|result|spec|plan|command|line|summary) says?\b": "reports, prints, shows",
    r"(?:^|[.!?] )Where [a-z]": "if, when",
    r"\b(?:this|that|another|other|first|last) ones?\b|\bones\b": "the noun",
}
"""What no page has, and what to write in its place."""
LEFT_OUT = ("docs/changelog.md", "docs/reference/commands.md", "docs/reference/python.md")
"""The changelog tells what was; the two others are made from the code."""


def find_listed_words(text: str) -> list[str]:
    """Each listed word in a page's prose and tables, with its surroundings and its replacement."""
    prose = re.sub(r"\]\([^)]*\)|^#+ ", "] ", FENCE.sub("", text), flags=re.MULTILINE)
    prose = re.sub(r"`[^`\n]*`", "CODE", prose)
    return [
        f"…{prose[max(0, found.start() - 40) : found.end() + 40]}…: write {instead!r}"
        for word, instead in WORDS.items()
        for found in re.finditer(word, prose, re.MULTILINE)
    ]


@pytest.mark.parametrize("page", [page for page in PAGES if page not in LEFT_OUT])
def test_a_page_has_the_fields_words(page: str) -> None:
    assert find_listed_words(read_page(page)) == []


def test_listed_words_are_found_in_prose_alone() -> None:
    text = "## Where it stands\n\nRight on 3 bare objects. Where none lies, `bare` [a run](bare.md) goes on.\n"
    found = find_listed_words(text.lower().replace(". where", ". Where"))
    assert [one.rpartition("write ")[2] for one in found] == [
        "'correct'",
        "'without a booster, unmodified'",
        "'if, when'",
    ]


def test_no_exception_is_left_over() -> None:
    assert [page for page in LEFT_OUT if page not in PAGES] == []


MOST_NUMBERS = 30
"""Numbers in 1000 words of a how-to page: what was measured lies on the pages of results."""


def count_numbers(text: str) -> float:
    """Return the numbers in 1000 words of a page, without code, links, numbers of lists and names such as ResNet-18."""
    prose = re.sub(r"`[^`\n]*`|\]\([^)]*\)|^ *\d+\. ", " CODE ", FENCE.sub("", text), flags=re.MULTILINE)
    return 1000 * len(re.findall(r"(?<![\w.,-])\d[\d.,]*", prose)) / len(prose.split())


@pytest.mark.parametrize("page", [page for page in PAGES if page.startswith("docs/tasks/")])
def test_a_how_to_page_holds_the_task_and_no_measurements(page: str) -> None:
    assert count_numbers(read_page(page)) <= MOST_NUMBERS


def test_numbers_are_counted_in_prose_and_tables() -> None:
    text = "1. ResNet-18 gets 39 of 72\n\n| 54.5 % | `x 9` | [a](b2.md) |\n\n```sh\necho 12\n```\n"
    assert count_numbers(text) == pytest.approx(1000 * 3 / 15)
