"""The page in headless Chromium: it predicts, follows the user, asks no network, and fits any width."""

import subprocess
import sys

import pytest
from conftest import ROOT

from repro.demo.runtime import cached_archive

pytestmark = pytest.mark.slow

TIMEOUT_MS = 120_000


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    if not cached_archive().is_file():
        pytest.skip(f"{cached_archive()} is missing: python run.py task=demo downloads it")
    outputs = tmp_path_factory.mktemp("demo")
    command = [sys.executable, "run.py", "task=demo", f"outputs={outputs}"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stdout + done.stderr
    assert [path.name for path in outputs.glob("*.*")] == ["demo.html"]
    return outputs / "demo.html"


@pytest.fixture
def open_tab(browser, page):
    """Return a function that opens the page; at the end, there were neither errors nor requests."""
    tabs, errors, requests = [], [], []

    def open_page(width=1280, scheme="light", address="#seed=17&exp=4"):
        tab = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        tab.set_default_timeout(TIMEOUT_MS)
        tab.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.on("request", lambda request: requests.append(request.url))
        tab.goto(page.as_uri() + address)
        tab.wait_for_function("document.getElementById('iou').textContent !== '–'")
        tabs.append(tab)
        return tab

    yield open_page
    for tab in tabs:
        tab.close()
    assert not errors
    assert all(url.startswith(("file:", "data:", "blob:")) for url in requests)


def image(name):
    return f"document.getElementById('{name}').toDataURL()"


def changes(tab, name, act):
    """Do something, and wait until a panel shows another image than before."""
    before = tab.evaluate(image(name))
    act()
    tab.wait_for_function(f"{image(name)} !== {before!r}")


def gray_around(tab, name, x, y, half=2.5):
    """Return the gray values of a panel in a square around a point [m], darkest first."""
    return tab.evaluate(
        """([name, x, y, half]) => {
            const canvas = document.getElementById(name), scale = canvas.width / 50;
            const box = [(x - half) * scale, (50 - y - half) * scale, 2 * half * scale, 2 * half * scale];
            const { data } = canvas.getContext("2d").getImageData(...box.map(Math.round));
            return [...data].filter((_, i) => i % 4 === 0).sort((a, b) => a - b);
        }""",
        [name, x, y, half],
    )


def an_obstacle(tab):
    """Return a point [m] in an obstacle of the world panel, by its color."""
    return tab.evaluate(
        """() => {
            const canvas = document.getElementById("world"), { width } = canvas;
            const { data } = canvas.getContext("2d").getImageData(0, 0, width, width);
            const is = (row, column) => data[4 * (row * width + column)] === 0x9a; // --obstacle in style.css
            for (let row = 0; row < width - 40; row++) for (let column = 20; column < width - 20; column++)
                if (is(row, column) && is(row + 20, column) && is(row + 40, column))
                    return [((column + 0.5) / width) * 50, 50 - ((row + 20) / width) * 50];
        }"""
    )


def drag(tab, start, end):
    tab.locator("#world").scroll_into_view_if_needed()
    box = tab.locator("#world").bounding_box()

    def at(point):
        return box["x"] + point[0] / 50 * box["width"], box["y"] + (1 - point[1] / 50) * box["height"]

    tab.mouse.move(*at(start))
    tab.mouse.down()
    tab.mouse.move(*at(end), steps=5)  # and hold it there


@pytest.mark.parametrize(("width", "scheme"), [(360, "dark"), (1280, "light")])
def test_the_page_fits_any_width(open_tab, width, scheme):
    tab = open_tab(width, scheme)
    assert tab.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    assert tab.evaluate("getComputedStyle(document.body).backgroundColor") == (
        "rgb(21, 24, 27)" if scheme == "dark" else "rgb(255, 255, 255)"
    )
    names = tab.evaluate(
        "[...document.querySelectorAll('button, select, input, canvas')].filter((element) => !(element.ariaLabel "
        "|| element.textContent.trim() || element.labels?.length)).map((element) => element.outerHTML)"
    )
    assert not names  # every control has a label
    assert tab.inner_text("#status") == ""


def test_the_prediction_finds_most_obstacles_of_a_world_of_the_study(open_tab):
    tab = open_tab(address="#seed=17&exp=4&paused")
    assert tab.inner_text("#clock") == "10.0 s"
    assert float(tab.inner_text("#iou")) > 0.35
    assert float(tab.inner_text("#accuracy")) > 0.92


def test_an_obstacle_dragged_before_the_robot_appears_on_the_map(open_tab):
    tab = open_tab(address="#seed=17&exp=4&paused")
    target = (20, 25 + 2.5 + 8)  # the robot is back at its start and drives up
    assert gray_around(tab, "prediction", *target)[0] > 127
    changes(tab, "prediction", lambda: drag(tab, an_obstacle(tab), target))
    darkest = []
    while len(darkest) < 15 and min(darkest, default=255) >= 64:  # what no motion explains is accepted after a second
        changes(tab, "prediction", lambda: tab.evaluate("document.getElementById('step').click()"))
        darkest.append(gray_around(tab, "prediction", *target)[0])
    assert min(darkest) < 64, darkest


def test_every_control_acts(open_tab):
    tab = open_tab(address="#seed=17&exp=3&paused")
    changes(tab, "prediction", lambda: tab.select_option("#network", label="U-Net, experiment 4"))
    changes(tab, "world", lambda: tab.click("#new-world"))
    changes(tab, "world", lambda: tab.select_option("#experiment", "2"))
    assert tab.inner_text("#play") == "Play"
    changes(tab, "world", lambda: tab.click("#play"))
    assert tab.inner_text("#play") == "Pause"
    assert float(tab.inner_text("#frame-time").removesuffix(" ms")) > 0
