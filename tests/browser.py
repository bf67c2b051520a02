"""A real Chromium for tests of pages: as wide as wanted, light or dark, and what it noticed."""

from __future__ import annotations

import json
import shutil
from importlib.resources import files
from importlib.util import find_spec

import pytest

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")

NEEDS_BROWSER = [
    pytest.mark.service,
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="no Chromium with its chromedriver"),
]

SIZES = {"desktop": (1400, 1000), "phone": (390, 844)}


def start_browser():
    """A browser that can reach nothing but this machine."""
    selenium = pytest.importorskip("selenium.webdriver", reason="pip install mammosim[browser]")
    from selenium.webdriver.chrome.service import Service

    options = selenium.ChromeOptions()
    options.binary_location = CHROMIUM
    for option in ("--headless=new", "--no-sandbox", "--window-size=1500,1000",
                   "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"):  # fmt: skip
        options.add_argument(option)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = selenium.Chrome(options=options, service=Service(DRIVER))
    driver.set_script_timeout(120)
    return driver


def appear(driver, size: str = "desktop", scheme: str = "light") -> None:
    """Take on a screen's size and the reader's choice of light or dark."""
    width, height = SIZES[size]
    driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": size == "phone"},
    )
    chosen = [{"name": "prefers-color-scheme", "value": scheme}]
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": chosen})


SETTLED = """
const done = arguments[arguments.length - 1];
const moving = () => document.getAnimations().filter((one) => one.playState === "running"
  && one.effect.getComputedTiming().endTime !== Infinity
  && !one.effect.target.closest(".q-linear-progress"));
requestAnimationFrame(() => requestAnimationFrame(async () => {
  while (moving().length) await new Promise((later) => setTimeout(later, 20));
  done();
}));
"""
"""Waits for transitions to end: half-way between light and dark, contrast is that of neither. It
looks again and again: the promise of a transition that starts anew may never be kept. The bar of a
run in progress may always be moving."""


def axe_findings(driver) -> list[str]:
    """What axe-core finds wrong with the page as it is shown now."""
    if find_spec("axe_playwright_python") is None:
        pytest.skip("no axe-core: pip install mammosim[browser]")
    axe = files("axe_playwright_python").joinpath("axe.min.js").read_text(encoding="utf-8")
    driver.execute_script(axe)
    driver.execute_async_script(SETTLED)
    found = driver.execute_async_script(
        "const done = arguments[arguments.length - 1];"
        "axe.run(document).then((r) => done(r), (e) => done({failed: String(e)}))"
    )
    assert found.get("passes"), found.get("failed")
    return [
        f"{rule['id']}: {node['html'][:200]}: {node['failureSummary'][:300]}"
        for rule in found["violations"]
        for node in rule["nodes"]
    ]


def too_wide(driver) -> int:
    """By how many pixels the page must be moved sideways to be read."""
    return driver.execute_script("return document.documentElement.scrollWidth - innerWidth")


def asked_for(driver) -> list[str]:
    """Addresses that the browser has asked for since the last call."""
    asked = [json.loads(entry["message"])["message"] for entry in driver.get_log("performance")]
    return [
        message["params"]["request"]["url"]
        for message in asked
        if message["method"] == "Network.requestWillBeSent"
    ]


def complaints(driver) -> list[str]:
    """Errors and warnings on the browser's console since the last call."""
    entries = driver.get_log("browser")
    return [entry["message"] for entry in entries if entry["level"] in ("SEVERE", "WARNING")]
