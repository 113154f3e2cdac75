"""Pictures of the panel for the documents, by `python docs/images/shoot_panel.py`.

Serves the simulated LuGre rig, starts a run from the page, and takes it by day and by night; then
the robot, on a circle. Needs Chromium (Debian: apt-get install chromium).
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
from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

ROOT = Path(__file__).resolve().parents[2]
#: Until the second trial is under way; until the robot has gone round.
PLAYED_MS = 17_000
ROUND_MS = 25_000


def shoot_lugre(page: Page) -> None:
    """Take the page by day and by night."""
    start(page, "Identification tests")
    page.wait_for_timeout(PLAYED_MS)
    page.screenshot(path=ROOT / "docs/images/panel-light.png")
    page.emulate_media(color_scheme="dark")
    page.wait_for_timeout(500)
    page.screenshot(path=ROOT / "docs/images/panel-dark.png")


def shoot_robot(page: Page) -> None:
    """Take the page with the bodies in the plane."""
    start(page, "Circles of the robot")
    page.wait_for_timeout(ROUND_MS)
    page.screenshot(path=ROOT / "docs/images/panel-plane.png")


def shoot(link: str, take: Callable[[Page], None]) -> None:
    """Open the page at ``link``, ``take`` it, and stop what runs."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.goto(link)
        page.get_by_label("Your name").fill("Ada")
        page.get_by_role("button", name="Open the panel").click()
        take(page)
        page.get_by_role("button", name="Stop", exact=True).click()
        page.locator(".state-word", has_text="Idle").wait_for()
        browser.close()


def start(page: Page, title: str) -> None:
    """Start the procedure with that title, and answer what it asks."""
    page.get_by_role("button", name="Take control").click()
    page.get_by_role("link", name="Procedures", exact=True).click()
    page.get_by_role("button", name=re.compile(title)).click()
    page.get_by_role("button", name="Start…").click()
    page.get_by_role("button", name="Start now").click()
    page.get_by_role("radio").first.check()
    page.get_by_role("button", name="Answer").click()
    page.locator(".state-word", has_text="Running").wait_for()
    page.mouse.move(0, 0)


def rig_here(name: str) -> str:
    """Return a shipped rig, at an address of its own."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    text = (ROOT / "configs" / name).read_text()
    text = text.replace("parameters: plants/", f"parameters: {ROOT}/configs/plants/")
    # A shared host may be away for longer than a rig's own would.
    text = text.replace("stale_after: 20 ms", "stale_after: 500 ms")
    return f"{text}\nremote: {{listen: [tcp/127.0.0.1:{port}]}}\n"


def serve(name: str, take: Callable[[Page], None]) -> None:
    """Serve the rig as long as ``take`` needs."""
    with tempfile.TemporaryDirectory() as folder:
        rig = Path(folder) / "rig.yaml"
        rig.write_text(rig_here(name))
        daemon = subprocess.Popen(
            [sys.executable, "-m", "rigd", "serve", "--rig", str(rig), "--runs", folder],
            cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True,
            env={**os.environ, "RIGD_STATE": folder},
        )  # fmt: skip
        try:
            for line in daemon.stdout or ():
                if found := re.search(r"panel of .*: (http://\S+#\S+)", line):
                    shoot(found[1], take)
                    break
            else:
                raise SystemExit("the daemon did not start")
        finally:
            daemon.send_signal(signal.SIGTERM)
            daemon.communicate(timeout=60)


if __name__ == "__main__":
    serve("sim_lugre.yaml", shoot_lugre)
    serve("sim_articulated.yaml", shoot_robot)
