"""The pages as a whole: links lead somewhere, tables can be read, and what comes from the code is there."""

import re
import sys
from pathlib import Path

import pytest
from pages import DOCS, FENCE, PAGES, ROOT, read_page

sys.path.insert(0, str(DOCS / "scripts"))
LINK = re.compile(r"(?<!`)\]\(([^)\s]+)\)")
WIDEST_CELL = 140


def list_anchors(file: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub and the site make them."""
    text = FENCE.sub("", file.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\s-]", "", title).strip().lower().replace(" ", "-") for title in titles}


def find_broken_links(page: Path, text: str) -> list[str]:
    """Links of a page that lead to no file, or to no heading of it."""
    broken = []
    for link in LINK.findall(FENCE.sub("", text)):
        place, _, anchor = link.partition("#")
        if re.match(r"[a-z]+:", place):
            continue
        file = (page.parent / place).resolve() if place else page
        if not file.exists() or (anchor and file.suffix == ".md" and anchor not in list_anchors(file)):
            broken.append(link)
    return broken


@pytest.mark.parametrize("page", PAGES)
def test_links_and_pictures_are_there(page: str) -> None:
    assert not find_broken_links(PAGES[page], read_page(page))


def test_a_broken_link_is_found() -> None:
    text = "[a](docs/nosuch.md) ![b](docs/figures/pairs.jpg) [c](docs/results.md#nosuch) [d](docs/limits.md#misuse)"
    assert find_broken_links(ROOT / "README.md", text) == ["docs/nosuch.md", "docs/results.md#nosuch"]


def test_no_figure_is_left_over() -> None:
    shown = "".join(map(read_page, PAGES))
    assert [file.name for file in (DOCS / "figures").iterdir() if file.name not in shown] == []


@pytest.mark.parametrize("page", PAGES)
def test_tables_can_be_read(page: str) -> None:
    from reference import PART

    rows = [line for line in PART.sub("", FENCE.sub("", read_page(page))).splitlines() if line.startswith("|")]
    cells = [re.sub(r"!?\[([^]]*)\]\([^)]*\)", r"\1", cell).strip() for row in rows for cell in row.split("|")]
    assert [cell for cell in cells if len(cell) > WIDEST_CELL] == []


def test_every_page_is_in_the_site() -> None:
    config = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    listed = re.findall(r": ([\w/-]+\.md)$", config, re.MULTILINE)
    assert sorted(f"docs/{one}" for one in listed) == sorted(set(PAGES) - {"README.md"})


def test_what_comes_from_the_code_is_current() -> None:
    from reference import PART, fill_page, list_pages

    assert {file.name for file in list_pages()} >= {"commands.md", "python.md", "files.md", "contributing.md"}
    stale = [file.name for file in list_pages() if fill_page(text := file.read_text(encoding="utf-8")) != text]
    assert stale == [], f"run 'make reference': {', '.join(stale)}"
    for page in PAGES:
        assert not [line for line in PART.sub("", read_page(page)).splitlines() if line.startswith("<!-- ")], page
    assert fill_page("<!-- layers -->\nstale\n<!-- end -->").count("stale") == 0


def test_the_reference_has_every_command_and_option() -> None:
    """What the real help lists, the page lists."""
    import subprocess

    from reference import write_part

    page = write_part("commands", None)
    program = [sys.executable, "-m", "toolkit"]
    listed = subprocess.run([*program, "--help"], capture_output=True, text=True, check=True).stdout
    names = re.findall(r"^  ([a-z][a-z-]+(?: [a-z]+)?) {2,}\S", listed.split("\n\n", 3)[3], re.MULTILINE)
    assert len(names) > 20
    assert re.findall(r"^### toolkit (.+)$", page, re.MULTILINE) == names
    for name in ("train-patch", "eval", "print"):
        shown = subprocess.run([*program, name, "--help"], capture_output=True, text=True, check=True).stdout
        part = page.split(f"### toolkit {name}\n")[1].split("\n### ")[0]
        options = set(re.findall(r"^  (?:-\w, )?(--[a-z-]+)", shown, re.MULTILINE))
        assert len(options) > 10
        assert options - {"--help"} <= set(re.findall(r"--[a-z-]+", part))


def test_the_commands_without_json_are_named_and_all_have_quiet() -> None:
    text, *parts = re.split(r"^### toolkit ", read_page("docs/reference/commands.md"), flags=re.MULTILINE)
    said = next(line for line in text.splitlines() if "`--quiet` leaves it out" in line)
    assert all("--quiet" in part for part in parts)
    without = {part.splitlines()[0] for part in parts if "--json" not in part}
    named = re.search(r"([^;.]*) have no `--json`", said)
    assert named and set(re.findall(r"`([^`]+)`", named[1])) == without


def test_a_field_of_a_file_is_explained() -> None:
    from reference import write_part

    rows = write_part("fields", "toolkit.objects.spec.ObjectSpec").splitlines()
    assert any(row.startswith("| `class` | text or whole number | required | class that") for row in rows)
    assert any(row.startswith("| `length_mm` | number | required | longest side") for row in rows)


@pytest.mark.parametrize("page", PAGES)
def test_files_that_are_named_exist(page: str) -> None:
    """`NAME` and the like stand for anything; the changelog names what was."""
    named = re.findall(r"`((?:toolkit|docs|tests|examples)/[\w/.-]+)`", read_page(page))
    assert [one for one in named if not re.search(r"[A-Z]{3}", one) and not (ROOT / one).exists()] == []
