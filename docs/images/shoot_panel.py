"""Pictures of the panel for the documents, by `python docs/images/shoot_panel.py`.

Serves the simulated LuGre rig, starts a run from the page, and takes it by day and by night. Needs
Chromium (Debian: apt-get install chromium).
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

ROOT = Path(__file__).resolve().parents[2]
#: Until the second trial is under way.
PLAYED_MS = 17_000


def shoot(link: str) -> None:
    """Start a run at ``link`` and take the page."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.goto(link)
        page.get_by_label("Your name").fill("Ada")
        page.get_by_role("button", name="Open the panel").click()
        start(page)
        page.mouse.move(0, 0)
        page.wait_for_timeout(PLAYED_MS)
        page.screenshot(path=ROOT / "docs/images/panel-light.png")
        page.emulate_media(color_scheme="dark")
        page.wait_for_timeout(500)
        page.screenshot(path=ROOT / "docs/images/panel-dark.png")
        page.get_by_role("button", name="Stop", exact=True).click()
        page.locator(".state-word", has_text="Idle").wait_for()
        browser.close()


def start(page: Page) -> None:
    """Start the run, and answer what it asks."""
    page.get_by_role("button", name="Take control").click()
    page.get_by_role("link", name="Procedures", exact=True).click()
    page.get_by_role("button", name=re.compile("Identification tests")).click()
    page.get_by_label("current", exact=True).wait_for()
    page.get_by_role("button", name="Start…").click()
    page.get_by_role("button", name="Start now").click()
    page.get_by_role("radio").first.check()
    page.get_by_role("button", name="Answer").click()
    page.locator(".state-word", has_text="Running").wait_for()


def rig_here() -> str:
    """Return the shipped rig, at an address of its own."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    text = (ROOT / "configs" / "sim_lugre.yaml").read_text()
    text = text.replace("parameters: plants/", f"parameters: {ROOT}/configs/plants/")
    # A shared host may be away for longer than a rig's own would.
    text = text.replace("stale_after: 20 ms", "stale_after: 500 ms")
    return f"{text}\nremote: {{listen: [tcp/127.0.0.1:{port}]}}\n"


def main() -> None:
    """Serve the rig as long as it takes."""
    with tempfile.TemporaryDirectory() as folder:
        rig = Path(folder) / "rig.yaml"
        rig.write_text(rig_here())
        daemon = subprocess.Popen(
            [sys.executable, "-m", "rigd", "serve", "--rig", str(rig), "--runs", folder],
            cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True,
            env={**os.environ, "RIGD_STATE": folder},
        )  # fmt: skip
        try:
            for line in daemon.stdout or ():
                if found := re.search(r"panel of .*: (http://\S+#\S+)", line):
                    shoot(found[1])
                    break
            else:
                raise SystemExit("the daemon did not start")
        finally:
            daemon.send_signal(signal.SIGTERM)
            daemon.communicate(timeout=60)


if __name__ == "__main__":
    main()
