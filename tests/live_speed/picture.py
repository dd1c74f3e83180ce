"""Makes a picture of the live view of a run, as Chromium shows it in the middle of its light.

python tests/live_speed/picture.py RUN PICTURE           (setup/picture)
"""

import sys
from pathlib import Path

from live_page import browser, served
from playwright.sync_api import ViewportSize, expect

from views.live.layout import described
from views.live.server import View
from views.live.sources import timeline_of_run
from views.report.run_facts import read_result

SHARE = 0.7  # of the time of the run
SIZE: ViewportSize = {"width": 1100, "height": 860}


def main() -> None:
    """Serve the run, go to that moment, and take the picture."""
    run, picture = Path(sys.argv[1]).resolve(), sys.argv[2]
    facts = described(read_result(run)[1])
    view = View(run.name, facts, timeline_of_run(run), run, False, False, {"handshake": str})
    with served(view) as address, browser() as chromium:
        page = chromium.new_page(viewport=SIZE)
        page.goto(address)
        expect(page.locator("#status")).to_have_text("a run that is over")
        expect(page.locator("#clock")).not_to_have_text("0.000 s")  # it has all of it
        slider = page.get_by_label("time in s")
        slider.fill(str(SHARE * float(slider.get_attribute("max") or 0)))
        expect(page.locator(".fiber.lit.flowing").first).to_be_visible()
        expect(page.locator("#paths tbody td").last).to_have_text("stands")
        page.mouse.click(5, 5)  # the slider is not what one shall look at
        page.screenshot(path=picture)


if __name__ == "__main__":
    main()
