"""Take the screenshots of docs/inspection.md: the live page, the inspector, drawings and the report of a run.

    python tools/screenshots.py

It runs the shipped patrol with two learners, and needs Chromium ($MABIRDS_CHROMIUM, or on the PATH).
"""

import io
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import sync_playwright
from rich.console import Console
from rich.text import Text

from mabirds_bringup.run.processes import start, stop

ROOT = Path(__file__).resolve().parents[1]
IMAGES, PATROL = ROOT / "docs" / "images", ROOT / "ros_ws" / "config" / "patrol.yaml"
MABIRDS = [sys.executable, "-m", "mabirds_bringup"]
WIDTH, HEIGHT = 60, 32
INSPECTED_SECONDS = 9.0


def free_port() -> int:
    """A port that nobody serves."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def take(browser: object, address: str, file: str, width: int, *, wait: str = "", height: int = 900) -> None:
    """A picture of a page, once an element is there."""
    page = browser.new_page(viewport={"width": width, "height": height})  # type: ignore[attr-defined]
    page.goto(address)
    if wait:
        page.wait_for_selector(wait, timeout=60_000)
        page.wait_for_timeout(4000)
    page.screenshot(path=IMAGES / file, full_page=bool(wait))
    page.close()


def inspected() -> str:
    """What `mabirds inspect` has on the screen of a terminal after some seconds."""
    table = f"stty cols {WIDTH} rows {HEIGHT}; exec {' '.join(MABIRDS)} inspect"
    program = f"import pty; pty.spawn(['bash', '-c', {table!r}])"
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stdin=subprocess.DEVNULL)
    time.sleep(INSPECTED_SECONDS)
    process.terminate()
    output = process.communicate()[0].decode(errors="replace")
    frames = output.replace("\r", "").split("\x1b[2K")
    return "".join(frames[frame_start(frames) :])


def frame_start(frames: list[str]) -> int:
    """Where the newest whole frame begins: after the last run of lines that were taken back."""
    ends = [number for number, text in enumerate(frames) if "\n" in text and "player" in text]
    return ends[-1] if ends else 0


def inspect_picture() -> None:
    """The table as SVG."""
    console = Console(width=WIDTH, record=True, file=io.StringIO())
    console.print(Text.from_ansi(inspected()))
    picture = console.export_svg(title="mabirds inspect")
    without_fonts = re.sub(r"@font-face \{.*?\}|<!--.*?-->", "", picture, flags=re.DOTALL)  # they would be fetched
    (IMAGES / "inspect.svg").write_text(without_fonts, encoding="utf-8")


def main() -> None:
    """Run the patrol and take pictures."""
    os.environ["ROS_DOMAIN_ID"] = os.environ.get("ROS_DOMAIN_ID", "77")
    chromium = os.environ.get("MABIRDS_CHROMIUM") or shutil.which("chromium")
    port = free_port()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "logs").mkdir()
        run = [*MABIRDS, "run", str(PATROL), "--hz", "1", "--out", str(folder / "runs")]
        page = [*MABIRDS, "dashboard", str(PATROL), "--port", str(port), "--key", "key"]
        draw = [*MABIRDS, "draw", str(PATROL), "--demonstrations"]
        processes = [
            start(name, command, folder / "logs") for name, command in (("page", page), ("draw", draw), ("run", run))
        ]
        try:
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
                address = f"http://127.0.0.1:{port}/?key=key"
                time.sleep(12)  # some of it is learned
                take(browser, address, "dashboard.png", 1280, wait="[data-testid=map-learner_2-2] svg")
                inspect_picture()
                processes[-1].popen.wait(timeout=300)
                latest = (folder / "runs" / "latest").resolve()
                take(browser, f"file://{latest}/report.html", "report.png", 1000)
                shutil.copy(latest / "delivered.png", IMAGES / "delivered.png")
                subprocess.run([*MABIRDS, "picture", str(IMAGES / "drawn.png")], check=True)
                browser.close()
        finally:
            stop(processes)


if __name__ == "__main__":
    main()
