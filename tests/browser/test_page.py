"""The page in a real browser: it draws, each control does what it says, and it asks nobody but this machine."""

from __future__ import annotations

import io
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest
from orograph.console.page import Page, open_server
from orograph.console.played import played
from orograph.launch.lifecycle import run
from orograph.storage.scenario_file import load_scenario
from PIL import Image
from playwright.sync_api import Page as Tab
from playwright.sync_api import sync_playwright

BROWSER = next((path for name in ("chromium", "google-chrome") if (path := shutil.which(name))), None)
pytestmark = [pytest.mark.browser, pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")]
SOFTWARE = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PAGE_MAX_BYTES = 1_500_000
WITHIN_S = 60


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    film = played(run(load_scenario("scenarios/tiny"), tmp_path_factory.mktemp("run") / "run", in_process=True))
    stop, page = threading.Event(), Page(open_server("127.0.0.1", 0), lambda: film)
    turning = threading.Thread(target=page.run, args=(stop,))
    turning.start()
    yield page.url
    stop.set()
    turning.join(20)


@dataclass
class Seen:
    tab: Tab
    asked: list[str] = field(default_factory=list)

    def picture(self) -> np.ndarray:
        """The middle of the scene, between the panels."""
        shot = self.tab.screenshot(clip={"x": 330, "y": 180, "width": 600, "height": 360})
        return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), np.int16)

    def until(self, done: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + WITHIN_S
        while not done():
            assert time.monotonic() < deadline_s
            self.tab.wait_for_timeout(200)

    def press(self, button: str) -> None:
        self.tab.get_by_role("button", name=button, exact=True).click()


@pytest.fixture(scope="module")
def seen(url: str) -> Iterator[Seen]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=SOFTWARE)
        seen = Seen(browser.new_page(viewport={"width": 1280, "height": 720}))
        seen.tab.on("request", lambda request: seen.asked.append(request.url))
        answer = seen.tab.goto(url)
        assert answer is not None and len(answer.body()) <= PAGE_MAX_BYTES
        seen.tab.locator(".mantine-Notification-closeButton").click(timeout=WITHIN_S * 1000)
        yield seen
        browser.close()


def colours(picture: np.ndarray) -> int:
    return len(np.unique(picture.reshape(-1, 3) // 16, axis=0))


def test_the_map_is_drawn_and_nobody_outside_is_asked(seen: Seen) -> None:
    seen.until(lambda: colours(seen.picture()) > 60)
    assert seen.asked and all(
        url.startswith(("http://127.0.0.1:", "data:", "blob:http://127.0.0.1")) for url in seen.asked
    )


def test_time_can_be_stopped_and_its_end_be_had(seen: Seen) -> None:
    seen.press("end")
    seen.until(lambda: "all home" in seen.tab.inner_text("body"))
    seen.press("pause")
    before = seen.picture()
    seen.tab.get_by_role("slider").first.press("Home")
    seen.until(lambda: "0:00.0" in seen.tab.inner_text("body"))
    seen.until(lambda: bool((np.abs(seen.picture() - before) > 30).mean() > 0.05))


def test_each_way_to_colour_looks_different(seen: Seen) -> None:
    seen.press("end")
    pictures, menu = [], seen.tab.locator("input[role=combobox]:not([readonly])").first
    for label in ("occupation", "error"):
        before = seen.picture()
        menu.click()
        seen.tab.get_by_role("option", name=label).click()
        seen.until(lambda before=before: bool((np.abs(seen.picture() - before) > 30).mean() > 0.1))
        pictures.append(seen.picture())
    assert colours(pictures[0]) > 10 and colours(pictures[1]) > 10


def test_a_click_tells_the_cell(seen: Seen) -> None:
    seen.tab.get_by_role("tab", name="cell").click()
    seen.tab.mouse.click(640, 400)
    seen.until(lambda: "how it came about" in seen.tab.inner_text("body"))
    assert "free_share" in seen.tab.inner_text("body")
