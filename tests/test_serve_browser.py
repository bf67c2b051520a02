"""The local page in a real browser: from the form to a picture, mistakes, cancel, reload."""

from __future__ import annotations

import io
import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
import zipfile
from itertools import product

import pytest
from browser import (
    NEEDS_BROWSER,
    SIZES,
    appear,
    asked_for,
    axe_findings,
    complaints,
    start_browser,
    too_wide,
)
from make_run import SMALL, save_breast

from mammosim.config import write_yaml

pytestmark = NEEDS_BROWSER

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
    compression = {**SMALL["compression"], "solver": "relaxation", "max_sweeps": 1_000_000}
    small = {"phantom": breast, **SMALL, "compression": compression, "views": ["CC"],
             "report": {"three_d": False}}  # fmt: skip
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


@pytest.fixture(scope="module")
def chromium():
    driver = start_browser()
    yield driver
    driver.quit()


@pytest.fixture
def browser(page, chromium):
    appear(chromium)
    chromium.get(page[0])
    yield chromium
    addresses, said = asked_for(chromium), complaints(chromium)
    assert addresses
    here = ("http://127.0.0.1:", "data:", "blob:http://127.0.0.1:")
    assert [url for url in addresses if not url.startswith(here)] == []
    assert said == []


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


def picture_addresses(browser) -> list[str]:
    """Windows of the pictures that are shown."""
    images = browser.find_elements("css selector", ".enlarged image")
    return [image.get_attribute("href").partition("?")[2] for image in images]


def live(browser) -> str:
    """What the page says of a run in progress."""
    return browser.find_element("css selector", ".runs [role=status]").text


def has_other_window(browser, before: set[str]) -> bool:
    """Whether all pictures have one other window after a step of the level's slider."""
    browser.execute_script(
        "document.querySelector('[aria-label=Level] [tabindex]').focus()"
    )  # fmt: skip
    browser.switch_to.active_element.send_keys("\ue014")  # arrow to the right
    time.sleep(0.5)
    now = set(picture_addresses(browser))
    return len(now) == 1 and now != before


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
        "return performance.getEntriesByType('resource')"
        ".some((one) => one.name.includes('/picture/') && one.decodedBodySize > 1000)"
    )
    until(lambda: browser.execute_script(loaded), "the picture")
    text = browser.find_element("tag name", "body").text
    assert "how far it moved" in text
    assert "ball" in text
    marks = "return [...document.querySelectorAll('.mark title')].map((t) => t.textContent)"
    assert browser.execute_script(marks) == ["1: ball", "N: nipple"]
    assert picture_addresses(browser) == ["level=0.5&width=1"]
    until(lambda: has_other_window(browser, {"level=0.5&width=1"}), "another window")
    frame = browser.find_element("css selector", "iframe.planes-frame")
    browser.switch_to.frame(frame)
    image = lambda: browser.find_element("css selector", ".plane image").get_attribute("href")  # noqa: E731
    until(lambda: browser.find_elements("css selector", ".plane image"), "the planes")
    before = image()
    browser.find_element("id", "shift-slider").send_keys("\ue010")  # End
    until(lambda: image() != before, "the compressed breast")
    assert browser.find_element("id", "shift-said").text == "compressed"
    browser.switch_to.default_content()
    curves = ".q-expansion-item .curves"
    assert not browser.find_elements("css selector", curves)
    browser.find_element("xpath", "//*[@role='button'][contains(., 'Convergence')]").click()
    until(lambda: browser.find_elements("css selector", f"{curves} svg path"), "the curves")


def test_a_wrong_value_is_refused_at_its_field(browser, page):
    before = sorted(page[1].glob("*")) if page[1].exists() else []
    write_into(field(browser, "compression.thickness_mm"), "thin")
    button(browser, "Run").click()
    path = "//label[.//input[contains(@aria-label, '(compression.thickness_mm)')]]"
    said = lambda: browser.find_element("xpath", path).text  # noqa: E731
    until(lambda: "found 'thin'" in said(), "the message at the field")
    assert (sorted(page[1].glob("*")) if page[1].exists() else []) == before


ENDLESS = {"compression.relaxation_limit_voxel": "1e-9", "compression.resolution_mm": "0.7"}
"""Some ten thousand sweeps of 20 ms: minutes that the test does not wait for."""


def start_endless_run(browser) -> None:
    """One whose compression goes on until it is cancelled, however fast the machine is."""
    for key, value in ENDLESS.items():
        write_into(field(browser, key), value)
    button(browser, "Run").click()
    until(lambda: statuses(browser)[:1] == ["running"], "the run")


def test_two_runs_a_reload_and_a_cancel(browser, page):
    """The first would never end; the second waits, and is made after it."""
    start_endless_run(browser)
    write_into(field(browser, "compression.relaxation_limit_voxel"), "1e-3")
    write_into(field(browser, "compression.resolution_mm"), "3")
    button(browser, "Run").click()
    until(lambda: statuses(browser)[:2] == ["waiting", "running"], "the second run in the queue")
    browser.refresh()
    until(lambda: statuses(browser)[:2] == ["waiting", "running"], "both runs after the reload")
    first = browser.find_elements("xpath", "//button[contains(., ': running')]")[0]
    first.click()
    until(lambda: "compressing" in live(browser), "the compression")
    button(browser, "Cancel").click()
    until(lambda: statuses(browser)[1] == "interrupted", "the end of the cancelled run")
    until(lambda: statuses(browser)[:2] == ["done", "interrupted"], "the second run")
    records = [json.loads(path.read_text())["status"] for path in page[1].glob("*/run.json")]
    assert "done" in records


def test_a_configuration_is_opened_and_its_mistakes_are_marked(browser, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "acquisition: {kvp: 28}\nexport: {dicom: perhaps}\nprojection: {pixel_mm: small}\n"
    )
    browser.find_element("css selector", "input[type=file]").send_keys(str(path))
    until(lambda: field(browser, "acquisition.kvp").get_attribute("value") == "28", "the file")
    button(browser, "Check").click()
    alarm = "[role=alert]"
    until(lambda: "export.dicom" in browser.find_element("css selector", alarm).text, "the alarm")
    # The closed section of the mistake has opened.
    until(lambda: field(browser, "projection.pixel_mm").is_displayed(), "the field of the mistake")
    assert axe_findings(browser) == []


def finish_a_run(browser) -> None:
    """Make a run, unless one is done already, and show it."""
    if "done" not in statuses(browser):
        button(browser, "Run").click()
        until(lambda: "done" in statuses(browser), "the end of the run")
    browser.find_elements("xpath", "//button[contains(., ': done')]")[0].click()
    until(lambda: browser.find_elements("css selector", "iframe.planes-frame"), "a finished run")


def test_runs_are_compared_side_by_side(browser, page):
    """Two runs: pictures under one window, what differs; also on a phone and in the dark."""
    finish_a_run(browser)
    done = statuses(browser).count("done")
    write_into(field(browser, "compression.thickness_mm"), "30")
    button(browser, "Run").click()
    until(lambda: statuses(browser).count("done") > done, "the end of the run")
    both = [number for number, status in enumerate(statuses(browser)) if status == "done"][:2]
    boxes = browser.find_elements("css selector", ".list .q-checkbox")
    for number in both:
        boxes[number].click()
    until(lambda: button(browser, "Compare").is_enabled(), "the button")
    button(browser, "Compare").click()
    until(lambda: "2 runs side by side" in browser.page_source, "both runs")
    text = browser.find_element("tag name", "body").text
    assert "(compression.thickness_mm)" in text
    assert "ball, LCC: shift" in text
    until(lambda: has_other_window(browser, {"level=0.5&width=1"}), "one window for both")
    assert len(picture_addresses(browser)) == 2
    browser.refresh()
    until(lambda: len(picture_addresses(browser)) == 2, "the same two runs after a reload")
    assert "2 runs side by side" in browser.page_source
    boxes = browser.find_elements("css selector", ".list .q-checkbox[aria-checked=true]")
    assert len(boxes) == 2
    for size, scheme in product(SIZES, ("light", "dark")):
        appear(browser, size, scheme)
        assert axe_findings(browser) == [], (size, scheme)
        assert too_wide(browser) <= 0


def test_every_state_is_accessible(browser):
    """The form with a finished run beside it in every look, and a run in progress."""
    finish_a_run(browser)
    for size, scheme in product(SIZES, ("light", "dark")):
        appear(browser, size, scheme)
        for pane in ("configuration", "runs") if size == "phone" else ("",):
            if pane:
                button(browser, pane).click()
            assert axe_findings(browser) == [], (size, scheme, pane)
            assert too_wide(browser) <= 0
    appear(browser)
    start_endless_run(browser)
    until(lambda: "compressing" in live(browser), "the compression")
    assert axe_findings(browser) == []
    button(browser, "Cancel").click()
    until(lambda: statuses(browser)[:1] == ["interrupted"], "its end")


def test_files_come_one_by_one_and_as_one_archive(browser, page):
    finish_a_run(browser)
    run = next(path.parent for path in sorted(page[1].glob("*/lesions.csv")))
    base = page[0].partition("/?")[0]
    token = page[0].partition("token=")[2]

    def fetch(path: str) -> bytes:
        request = urllib.request.Request(f"{base}/{path}", headers={"Cookie": f"mammosim={token}"})
        with urllib.request.urlopen(request) as answer:
            return answer.read()

    table = (run / "lesions.csv").read_bytes()
    assert fetch(f"file/{run.name}/lesions.csv") == table
    with zipfile.ZipFile(io.BytesIO(fetch(f"zip/{run.name}"))) as archive:
        assert archive.read(f"{run.name}/lesions.csv") == table
        assert archive.testzip() is None
    for beyond in ("file/../run.yaml", f"file/{run.name}/.stages/x", "zip/none", "planes/none"):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            fetch(beyond)
