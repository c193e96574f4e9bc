import re
from html.parser import HTMLParser

import pandas as pd
import pytest
from conftest import read_calls

from repro.baselines.registry import PREDICTORS
from repro.cli import main
from repro.reporting.papers_claims import CLAIMS

pytestmark = pytest.mark.slow

TINY = (
    *("scale=first", "scale.pairs.train=16", "scale.pairs.val=4", "scale.pairs.test=8", "scale.max_epochs=1"),
    "exp=3",
)


def run(outputs, *words):
    for call in read_calls(f"outputs={outputs}", "runtime.accelerator=cpu", "runtime.workers=1", *words):
        assert main.perform(call) is None


@pytest.fixture(scope="module")
def outputs(tmp_path_factory):
    """Run a small study with its analysis: U-Net with and without decay and with another input."""
    outputs = tmp_path_factory.mktemp("page") / "first"
    run(outputs, *TINY, "decay=true")
    run(outputs, *TINY, "decay=false")
    run(outputs, *TINY, "encoding=stack4")
    run(outputs, *TINY, "task=report")
    run(outputs, "task=analysis")  # the runs know their scale
    return outputs


def test_the_analysis_writes_all_frames_and_figures(outputs):
    names = {path.stem for path in outputs.glob("analysis/*.csv")}
    assert names == {*("intervals", "recency", "obstacles", "calibration", "reliability", "cost", "claims")}
    figures = {path.stem for path in outputs.glob("analysis/*.png")}
    assert figures == {"recency", "obstacles", "reliability", "baselines"}
    claims = pd.read_csv(outputs / "analysis" / "claims.csv")
    assert claims["id"].tolist() == [claim.id for claim in CLAIMS]
    assert claims["verdict"].notna().all()
    table = pd.read_csv(outputs / "tables" / "main.csv")
    assert table["model"].tolist() == ["unet", *(name for name in PREDICTORS if name != "mean_map")]


class Outline(HTMLParser):
    """The ids, links, sources and open tags of a page."""

    def __init__(self):
        super().__init__()
        self.ids, self.links, self.sources, self.open = [], [], [], []

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.ids += [given["id"]] if "id" in given else []
        self.links += [given["href"]] if "href" in given else []
        self.sources += [given["src"]] if "src" in given else []
        if tag not in ("meta", "link", "img", "input", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_is_complete_well_formed_and_self_contained(outputs):
    page = (outputs / "report.html").read_text()
    outline = Outline()
    outline.feed(page)
    assert not outline.open
    assert len(set(outline.ids)) == len(outline.ids)
    assert all(link.startswith(("#", "data:")) for link in outline.links)
    assert {link[1:] for link in outline.links if link.startswith("#")} <= set(outline.ids)
    assert all(source.startswith("data:image/png;base64,") for source in outline.sources)
    assert not re.search(r"https?://", page)
    assert len(page) < 15_000_000
    assert f"python run.py task=analysis scale=first outputs={outputs}" in page
    assert f"recordings in <code>{outputs}</code>" in page
    assert "Scale first: 32 x 32 px, 16 training and 8 test pairs" in page
    assert page.index("Accuracy differs from the paper") < page.index("<figure>") < page.index("<table>")
    for section in ("tables", "claims", "where", "calibration", "baselines"):
        assert f'<section id="{section}">' in page


@pytest.mark.parametrize(("width", "scheme"), [(360, "light"), (800, "light"), (1400, "dark")])
def test_the_page_works_in_a_browser_at_any_width(browser, outputs, width, scheme):
    tab = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
    errors, requests = [], []
    tab.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.on("request", lambda request: requests.append(request.url))
    tab.goto((outputs / "report.html").as_uri())
    assert tab.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    assert not errors
    assert all(url.startswith(("file:", "data:", "blob:")) for url in requests)
    tab.close()
