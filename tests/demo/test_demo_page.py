"""The page in headless Chromium: it predicts, follows the user, asks no network, and fits any width."""

import re

import pytest
from conftest import run_py

from repro.demo.runtime import cached_archive

pytestmark = pytest.mark.slow

TIMEOUT_MS = 120_000


@pytest.fixture(scope="module")
def page(tmp_path_factory, python):
    if not cached_archive().is_file():
        pytest.skip(f"{cached_archive()} is missing: python run.py task=demo downloads it")
    outputs = tmp_path_factory.mktemp("demo")
    done = run_py("task=demo", f"outputs={outputs}", python=python)
    assert done.returncode == 0, done.stdout + done.stderr
    assert [path.name for path in outputs.glob("*.*")] == ["demo.html"]
    return outputs / "demo.html"


@pytest.fixture
def open_tab(browser, page):
    """Return a function that opens the page; at the end, there were neither errors nor requests."""
    tabs, errors, requests = [], [], []

    def open_page(width=1280):
        tab = browser.new_page(viewport={"width": width, "height": 900})
        tab.set_default_timeout(TIMEOUT_MS)
        tab.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.on("request", lambda request: requests.append(request.url))
        tab.goto(page.as_uri())
        tab.wait_for_function("document.getElementById('status').textContent === ''")
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
            const is = (row, column) => data[4 * (row * width + column)] === 0x9a; // of an obstacle in drawing.js
            for (let row = 0; row < width - 16; row++) for (let column = 16; column < width - 16; column++)
                if (is(row, column) && is(row + 8, column) && is(row + 16, column))
                    return [((column + 0.5) / width) * 50, 50 - ((row + 8) / width) * 50];
        }"""
    )


def drag(tab, start, end):
    tab.locator("#world").scroll_into_view_if_needed()
    box = tab.locator("#world").bounding_box()

    def at(point):
        return box["x"] + point[0] / 50 * box["width"], box["y"] + (1 - point[1] / 50) * box["height"]

    tab.mouse.move(*at(start))
    tab.mouse.down()
    tab.mouse.move(*at(end), steps=5)
    tab.mouse.up()


@pytest.mark.parametrize("width", [360, 1280])
def test_the_page_fits_any_width(open_tab, width):
    tab = open_tab(width)
    assert tab.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    names = tab.evaluate(
        "[...document.querySelectorAll('button, select, canvas')].filter((element) => !(element.ariaLabel "
        "|| element.textContent.trim() || element.labels?.length)).map((element) => element.outerHTML)"
    )
    assert not names  # every control has a label


def test_an_obstacle_dragged_before_the_robot_appears_on_the_map(open_tab):
    tab = open_tab()
    tab.select_option("#experiment", index=0)  # the robot turns in the middle, and obstacles stand
    target = (25, 33)
    assert gray_around(tab, "prediction", *target)[0] > 127
    drag(tab, an_obstacle(tab), target)
    for _ in range(100):  # until the robot has turned to it
        if gray_around(tab, "prediction", *target)[0] < 64:
            return
        changes(tab, "prediction", lambda: None)
    pytest.fail("the map does not show the obstacle")


def test_every_control_acts(open_tab):
    tab = open_tab()
    changes(tab, "world", lambda: None)  # the robot drives
    tab.click("#play")
    assert tab.inner_text("#play") == "Play"
    changes(tab, "prediction", lambda: tab.select_option("#network", index=1))
    changes(tab, "world", lambda: tab.click("#new-world"))
    changes(tab, "world", lambda: tab.select_option("#experiment", index=1))
    changes(tab, "prediction", lambda: tab.click("#play"))
    assert tab.inner_text("#play") == "Pause"
    assert re.match(r"map \d+\.\d\d s behind", tab.inner_text("#lag"))
