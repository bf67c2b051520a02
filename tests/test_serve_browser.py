"""The local page in a real browser: from the form to a picture, mistakes, cancel, reload."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import pytest
from make_run import SMALL, save_breast

from mammosim.config import write_yaml

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")

pytestmark = [
    pytest.mark.service,
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="no Chromium with its chromedriver"),
]

WAIT_S = 240.0
"""For a small run, which may have to compile, on a machine that does other things."""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Address of the page, and its folder of runs."""
    pytest.importorskip("nicegui", reason="pip install mammosim[serve]")
    folder = save_breast(tmp_path_factory.mktemp("page"))
    examples = folder / "examples"
    examples.mkdir()
    breast = {"file": str(folder / "breast.npz"), "lesions": [
        {"name": "ball", "kind": "mass", "diameter_mm": 6, "position_mm": [12, 8, 6]}]}  # fmt: skip
    small = {"phantom": breast, **SMALL, "views": ["CC"], "report": {"three_d": False}}
    write_yaml(small, examples / "quickstart.yaml")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    code = (
        "import sys; from pathlib import Path; from mammosim.serve import serve;"
        "from mammosim.cli.runs import _run_words;"
        "serve(int(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]), _run_words,"
        " lambda text: print(text, flush=True))"
    )
    words = [sys.executable, "-c", code, str(port), str(examples), str(folder / "runs")]
    environment = {key: value for key, value in os.environ.items() if "PYTEST" not in key}
    server = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=environment)
    assert server.stdout is not None
    address = server.stdout.readline().strip()
    until(lambda: is_open(port), "the port to be open")
    yield address, folder / "runs"
    server.send_signal(signal.SIGINT)
    server.wait(60)


@pytest.fixture
def browser(page):
    selenium = pytest.importorskip("selenium.webdriver", reason="pip install selenium")
    from selenium.webdriver.chrome.service import Service

    options = selenium.ChromeOptions()
    options.binary_location = CHROMIUM
    for option in ("--headless=new", "--no-sandbox", "--window-size=1500,1000",
                   "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"):  # fmt: skip
        options.add_argument(option)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = selenium.Chrome(options=options, service=Service(DRIVER))
    driver.get(page[0])
    yield driver
    asked = [json.loads(entry["message"])["message"] for entry in driver.get_log("performance")]
    addresses = [
        message["params"]["request"]["url"]
        for message in asked
        if message["method"] == "Network.requestWillBeSent"
    ]
    severe = [entry for entry in driver.get_log("browser") if entry["level"] == "SEVERE"]
    driver.quit()
    assert addresses
    assert [url for url in addresses if not url.startswith(("http://127.0.0.1:", "data:"))] == []
    assert severe == []


def is_open(port: int) -> bool:
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0


def until(condition, what: str):
    """What a condition gives once it is true."""
    end = time.monotonic() + WAIT_S
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.2)
    raise AssertionError(f"waited {WAIT_S:.0f} s for {what}")


def button(browser, text: str):
    path = f"//button[contains(normalize-space(.), '{text}')]"
    return until(lambda: browser.find_elements("xpath", path), f"button {text}")[0]


def field(browser, key: str):
    path = f"//input[contains(@aria-label, '({key})')]"
    return until(lambda: browser.find_elements("xpath", path), f"field {key}")[0]


def statuses(browser) -> list[str]:
    """Of the runs in the list, the latest first."""
    texts = browser.execute_script(
        "return [...document.querySelectorAll('button')].map((b) => b.innerText)"
    )
    return [text.rpartition(": ")[2] for text in texts if text.startswith("quickstart-")]


def write_into(entry, text: str) -> None:
    entry.send_keys("\ue009a\ue000")  # Ctrl-A
    entry.send_keys(text)


def test_the_page_is_closed_without_its_token(page):
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(page[0].partition("?")[0])


def test_a_run_leads_from_the_form_to_its_picture(browser):
    button(browser, "Run").click()
    until(lambda: statuses(browser)[:1] == ["done"], "the end of the run")
    loaded = (
        "return [...document.images].some((i) => i.src.includes('/picture/') && i.naturalWidth)"
    )
    until(lambda: browser.execute_script(loaded), "the picture")
    text = browser.find_element("tag name", "body").text
    assert "how far it moved" in text
    assert "ball" in text
    circles = "return document.querySelectorAll('svg circle').length"
    assert browser.execute_script(circles) >= 2  # lesion and nipple


def test_a_wrong_value_is_refused_at_its_field(browser, page):
    before = sorted(page[1].glob("*")) if page[1].exists() else []
    write_into(field(browser, "compression.thickness_mm"), "thin")
    button(browser, "Run").click()
    path = "//label[.//input[contains(@aria-label, '(compression.thickness_mm)')]]"
    said = lambda: browser.find_element("xpath", path).text  # noqa: E731
    until(lambda: "found 'thin'" in said(), "the message at the field")
    assert (sorted(page[1].glob("*")) if page[1].exists() else []) == before


def test_two_runs_a_reload_and_a_cancel(browser, page):
    """The first is slow enough to be cancelled; the second waits, and is made after it."""
    write_into(field(browser, "compression.resolution_mm"), "0.6")
    button(browser, "Run").click()
    until(lambda: statuses(browser)[:1] == ["running"], "the first run")
    write_into(field(browser, "compression.resolution_mm"), "3")
    button(browser, "Run").click()
    until(lambda: statuses(browser)[:2] == ["waiting", "running"], "the second run in the queue")
    browser.refresh()
    until(lambda: statuses(browser)[:2] == ["waiting", "running"], "both runs after the reload")
    first = browser.find_elements("xpath", "//button[contains(., ': running')]")[0]
    first.click()
    time.sleep(2.0)  # let it begin to compress
    button(browser, "Cancel").click()
    until(lambda: statuses(browser)[:2] == ["done", "interrupted"], "cancel, and the second run")
    records = [json.loads(path.read_text())["status"] for path in page[1].glob("*/run.json")]
    assert "done" in records
