"""The site builds without a warning, and is read without a network."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from pages import ROOT

pytest.importorskip("mkdocs", reason="the site is built with the extra 'site'")
pytest.importorskip("material", reason="the site is built with the extra 'site'")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def test_nothing_is_fetched(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        fetched = re.findall(r'<(?:script|img|link|iframe)[^>]*?(?:src|href)="?((?:https?:)?//[^" >]+)', text)
        assert fetched == [], page.name
    for sheet in site.rglob("*.css"):
        assert not re.search(r"url\(\"?(?:https?:)?//", sheet.read_text(encoding="utf-8")), sheet.name


def test_the_themes_faults_are_mended(site: Path) -> None:
    """The Nu checker refuses both: an empty tabindex, and autocomplete of a checkbox."""
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert 'tabindex=""' not in text and not re.search(r'type="checkbox"[^>]*autocomplete', text), page.name


def test_pages_have_what_the_code_says(site: Path) -> None:
    commands = (site / "reference/commands.html").read_text(encoding="utf-8")
    assert 'id="toolkit-train-patch"' in commands and "--recipe" in commands
    files = (site / "reference/files.html").read_text(encoding="utf-8")
    assert "<code>length_mm</code>" in files
    assert (site / "results/captures.csv").is_file()


def test_scripts_and_records_are_not_published(site: Path) -> None:
    assert not (site / "scripts").exists() and not (site / "records").exists()


def test_every_page_is_listed_for_language_models(site: Path) -> None:
    text = (site / "llms.txt").read_text(encoding="utf-8")
    listed = re.findall(r"^- \[[^]]+\]\(([^)]+)\): \S", text, re.MULTILINE)
    pages = {page.relative_to(site).as_posix() for page in site.rglob("*.html")} - {"404.html"}
    assert sorted(listed) == sorted(pages)


def test_the_site_has_its_own_logo_and_icon(site: Path) -> None:
    home = (site / "index.html").read_text(encoding="utf-8")
    assert re.search(r'rel="?icon"? href="?assets/favicon\.svg', home) and "assets/logo.svg" in home
    assert (site / "assets/favicon.svg").is_file() and (site / "assets/logo.svg").is_file()
