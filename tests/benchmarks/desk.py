"""How long a page of the desk takes from a move of a slider to the redrawn state, in Debian's chromium.

`python tests/benchmarks/desk.py mayekawa-wbhe` needs `pip install playwright` and the package chromium.
The page takes the time itself, between the movement of the mouse and the frame with the new result.
"""

import shutil
import statistics
import sys

from playwright.sync_api import sync_playwright

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


def main():
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
