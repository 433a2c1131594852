"""The page of all runs, as a browser shows it: filters, sorting, pictures, at a phone's width and by the keyboard."""

import re

import pytest
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.evaluate import evaluate_captures

SHOWN = "return [...document.querySelectorAll('#rows tr')].filter(one => !one.hidden).map(one => ({...one.dataset}))"
CHOOSE = (
    "const box = document.querySelector(`[data-filter=${arguments[0]}]`); box.value = arguments[1];"
    "box.dispatchEvent(new Event('change'))"
)
CARDS = "return [...document.querySelectorAll('#flip-deck article')].filter(one => !one.hidden).length"


@pytest.fixture
def page(put, workspace, colour_classifier):
    """Runs `night` and `fog` of two objects; the patch gains two racers and loses a warplane."""
    for pose in (1, 2):
        put(f"sim/racer/unpatched/{pose}.png", "warplane")
        put(f"sim/racer/patched/{pose}.png", "racer")
        put(f"sim/warplane/unpatched/{pose}.png", "warplane")
        put(f"sim/warplane/patched/{pose}.png", "racer" if pose == 1 else "warplane")
    evaluate_captures(workspace.captures_dir, workspace, colour_classifier, EvalConfig(run="night"))
    config = EvalConfig(run="fog", corruptions=(("brightness", 1),))
    evaluate_captures(workspace.captures_dir, workspace, colour_classifier, config)
    done = CliRunner().invoke(app, ["report", "--all", "--workspace", str(workspace.root)])
    assert done.exit_code == 0 and "2 runs" in done.stdout
    return workspace.eval_dir / "index.html"


def test_the_page_needs_nothing_else(page):
    text = page.read_text()
    assert not re.findall(r"(?:src|href)=\"(?!#|data:|[\w-]+/report\.html)", text) and "://" not in text
    assert 'href="night/report.html"' in text
    # each picture once, though two runs and three sources saw it
    assert text.count("data:image/jpeg") == len(set(re.findall(r"data:image/jpeg[^\"]*", text))) <= 8
    assert page.stat().st_size < 200_000


@pytest.mark.parametrize("words", [[], ["--all", "night"]])
def test_runs_are_named_or_all_of_them(page, words):
    done = CliRunner().invoke(app, ["report", *words, "--workspace", str(page.parents[1])])
    assert "name runs, or give --all" in str(done.exception)


def test_a_run_with_damaged_predictions_keeps_its_rows(page, as_older):
    as_older(page.parent / "fog")
    (page.parent / "fog" / "predictions.csv").write_text("nothing\n")
    done = CliRunner().invoke(app, ["report", "--all", "--workspace", str(page.parents[1])])
    assert done.exit_code == 1 and "skipped fog:" in done.stderr and "no column" in done.stderr
    assert 'data-run="fog"' in page.read_text()


@pytest.mark.slow
def test_a_phone_filters_sorts_and_shows_flips(browser, page):
    browser.get(page.as_uri())
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 390
    rows = browser.execute_script(SHOWN)
    assert {row["object"] for row in rows} == {"all"} and len(rows) == 6  # night; sim and its fog, bare and patched
    browser.execute_script(CHOOSE, "object", "racer")
    assert {row["object"] for row in browser.execute_script(SHOWN)} == {"racer"}
    browser.execute_script(CHOOSE, "run", "night")
    rows = browser.execute_script(SHOWN)
    assert [(row["variant"], row["share"]) for row in rows] == [("unpatched", "0.0"), ("patched", "1.0")]
    assert browser.execute_script(CARDS) == 2
    widths = browser.execute_script(
        "return [...document.querySelectorAll('#flip-deck article:not([hidden]) img')].map(one => one.naturalWidth)"
    )
    assert len(widths) == 4 and min(widths) > 0
    browser.execute_script(CHOOSE, "condition", "brightness")
    assert browser.execute_script(SHOWN) == []


@pytest.mark.slow
def test_a_keyboard_is_enough(browser, page):
    from selenium.webdriver.common.keys import Keys

    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": 1200, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    )
    browser.get(page.as_uri())
    for _ in range(40):
        focused = browser.switch_to.active_element
        if focused.get_attribute("data-sort") == "share":
            break
        focused.send_keys(Keys.TAB)
    browser.switch_to.active_element.send_keys(Keys.ENTER)
    shares = [float(row["share"]) for row in browser.execute_script(SHOWN)]
    assert shares == sorted(shares) and len(set(shares)) > 1
    browser.switch_to.active_element.send_keys(Keys.SPACE)
    turned = [float(row["share"]) for row in browser.execute_script(SHOWN)]
    assert turned == shares[::-1] or turned == sorted(shares, reverse=True)
    state = "return document.querySelector('[data-sort=share]').parentElement.ariaSort"
    assert browser.execute_script(state) == "descending"
    assert not [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]
