"""Makes docs/live.webp, the picture of the live page: python docs/live_picture.py RUN SECOND

RUN is the folder of a walk (surefoot simulate home --seed 3); needs Chromium, driven by the client of the tests.
"""

import sys
import tempfile
from pathlib import Path

import cv2

from surefoot.report.live_view import LivePage
from surefoot.results.run_folder import RunFolder

DOCS = Path(__file__).resolve().parent
SIZE_PX = (1300, 900)
QUALITY = 80
sys.path.append(str(DOCS.parent / "tests" / "surefoot" / "report"))


def main(run: str, second: str, out: Path = DOCS / "live.webp") -> None:
    """Open the page of a run at a time, and keep what the window shows."""
    from browser import Browser

    page = LivePage()
    page.follow(RunFolder.open(Path(run)))
    with tempfile.TemporaryDirectory() as folder, Browser(Path(folder)) as browser:
        browser.open(page.address.replace("localhost", "127.0.0.1"), *SIZE_PX)
        browser.wait("document.documentElement.dataset.state?.startsWith('The run is over')")
        browser.run(f"location.hash = 't={second}'")
        shown = "document.getElementById('space').dataset.moment"
        browser.wait(f"{shown} === document.documentElement.dataset.drawn && {shown} === document.getElementById('instant').value")  # fmt: skip
        picture = Path(folder) / "page.png"
        browser.screenshot(picture, whole=False)
        cv2.imwrite(str(out), cv2.imread(str(picture)), [cv2.IMWRITE_WEBP_QUALITY, QUALITY])


if __name__ == "__main__":
    main(*sys.argv[1:])
