"""How long the desk takes to open, and to follow a move of a slider, in Debian's chromium.

`python tests/benchmarks/desk.py mayekawa-wbhe` needs `pip install playwright` and the package chromium.
The page takes the time of a move itself, between the movement of the mouse and the frame with the new
result. With `--start` the command is started twice, without and with the compiled programs that it keeps.
"""

import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time

from playwright.sync_api import Error, sync_playwright

from jaxcomp import load
from jaxcomp.desk import serve

PORT, MOVES = 5078, 15
WATCH = """() => {
  const inside = (root) => {
    for (const one of root.querySelectorAll("strong"))
      if (one.textContent.includes("fficiency")) return one;
    for (const one of root.querySelectorAll("*")) {
      const found = one.shadowRoot && inside(one.shadowRoot);
      if (found) return found;
    }
    return null;
  };
  let last = inside(document).textContent;
  const look = () => {
    const now = inside(document);
    if (now && now.textContent !== last) { last = now.textContent; window.seen = performance.now(); }
    requestAnimationFrame(look);
  };
  look();
  document.addEventListener("pointermove", () => { window.moved = performance.now(); }, true);
}"""


def start(machine):
    """Seconds from the command to a page with its numbers and to all gains, without and with a cache."""
    address = f"http://127.0.0.1:{PORT}/"
    command = [
        sys.executable,
        "-m",
        "jaxcomp",
        "desk",
        machine,
        "--no-browser",
        "--port",
        str(PORT),
    ]
    with sync_playwright() as started, tempfile.TemporaryDirectory() as cache:
        browser = started.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        for which in ("first", "second"):
            begun = time.perf_counter()
            desk = subprocess.Popen(command, env=os.environ | {"JAXCOMP_CACHE": cache})
            page = browser.new_page(viewport={"width": 1280, "height": 900})
            while desk.poll() is None:
                try:
                    page.goto(address)
                    break
                except Error:  # nobody listens yet
                    time.sleep(0.1)
            page.wait_for_selector(".numbers .tabulator-row", timeout=600_000)
            opened = time.perf_counter() - begun
            gains = page.locator(".numbers [tabulator-field=Gain]", has_text="...")
            while gains.count():
                page.wait_for_timeout(100)
            shown = time.perf_counter() - begun
            used = sum(os.times()[2:4])
            page.close()
            desk.send_signal(signal.SIGINT)
            desk.wait()
            used = sum(os.times()[2:4]) - used
            print(
                f"{which} start: page after {opened:.1f} s, gains after {shown:.1f} s, "
                f"{used:.1f} s of the processors"
            )
        browser.close()


def main():
    if "--start" in sys.argv:
        start(sys.argv[1])
        return
    server = serve(load(sys.argv[1]), show=False, threaded=True, port=PORT)
    with sync_playwright() as started:
        browser = started.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.goto(f"http://127.0.0.1:{PORT}/")
        page.wait_for_selector(".tabulator-row", timeout=120_000)
        page.wait_for_timeout(3000)
        handle = page.locator(".ranges .noUi-handle").first.bounding_box()
        page.evaluate(WATCH)
        page.mouse.move(handle["x"] + 5, handle["y"] + 5)
        page.mouse.down()
        times = []
        for number in range(MOVES):
            page.mouse.move(handle["x"] + 8 + 3 * number, handle["y"] + 5)
            page.wait_for_timeout(700)
            seen, moved = page.evaluate("[window.seen, window.moved]")
            times.append(seen - moved)
        page.mouse.up()
        browser.close()
    server.stop()
    print(f"median {statistics.median(times):.0f} ms of", [round(one) for one in times])


if __name__ == "__main__":
    main()
