"""The page in headless Chromium, against the command itself in a process of its own."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time

import pytest

PATIENCE_S = 150
"""For one step on a machine that is busy with other things; alone the whole test takes some seconds."""
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")


@pytest.fixture
def server(shot_space, tmp_path):
    """The running command: its address, and a function that presses Ctrl-C and returns what it printed."""
    environment = {**os.environ, "TOOLKIT_WEIGHTS": str(tmp_path), "TORCH_HOME": str(tmp_path), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "toolkit", "studio", "--workspace", str(shot_space.root), "--model", "rig18"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment, cwd=tmp_path
    )
    first = process.stdout.readline()
    url = re.match(r"http://127\.0\.0\.1:\d+/", first)
    assert url, first + process.communicate(timeout=PATIENCE_S)[0]

    def interrupt():
        process.send_signal(signal.SIGINT)
        return process.communicate(timeout=PATIENCE_S)[0], process.returncode

    yield url[0], interrupt
    if process.poll() is None:
        process.kill()
        process.wait()


@pytest.fixture
def browser():
    """A phone's screen in Chromium."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="needs selenium")
    if not CHROMIUM or not DRIVER:
        pytest.skip("needs Chromium and its driver (Debian: chromium, chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
    )
    yield driver
    driver.quit()


def wait_until(browser, script):
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        if browser.execute_script(f"return Boolean({script})"):
            return
        time.sleep(0.1)
    raise AssertionError(f"never: {script}\n{browser.execute_script('return document.body.innerText')}")


@pytest.mark.slow
def test_a_photograph_goes_from_the_file_picker_to_the_captures(server, browser, photo, tmp_path, shot_space):
    url, interrupt = server
    picture = tmp_path / "IMG_1.jpg"
    picture.write_bytes(photo(size=(640, 480)))
    browser.get(url)
    wait_until(browser, "document.querySelector('#take') && document.querySelector('#ghost').naturalWidth > 0")
    assert browser.execute_script("return document.querySelector('#count').textContent") == "0 of 4 kept"
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 390

    browser.find_element("id", "file").send_keys(str(picture))
    wait_until(browser, "document.querySelector('#verdict h2') && document.querySelector('#keep')")
    assert browser.execute_script("return document.querySelector('#verdict').innerText").strip()
    wait_until(browser, "document.querySelector('#grid .waiting')")

    browser.refresh()  # in the middle: the photograph still waits
    wait_until(browser, "document.querySelector('#keep')")
    browser.find_element("id", "keep").click()
    wait_until(browser, "document.querySelector('#count').textContent === '1 of 4 kept'")
    wait_until(browser, "document.querySelector('#number').textContent.includes('shot 2')")
    (kept,) = (shot_space.captures_dir / "real").rglob("pose_*.jpg")
    assert kept.read_bytes() == picture.read_bytes()

    trouble = [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]
    assert trouble == []
    said, code = interrupt()
    assert code == 0 and "1 of 4 shots are in" in said and "next: toolkit eval" in said


@pytest.mark.slow
def test_ctrl_c_right_away_ends_cleanly_and_says_where_to_go_on(server):
    said, code = server[1]()
    assert code == 0, said
    assert "0 of 4 shots" in said and "to go on" in said and "Traceback" not in said
