import re
import subprocess
import sys
from html.parser import HTMLParser

import pandas as pd
import pytest
from conftest import ROOT, read_calls

from repro.baselines.registry import PREDICTORS
from repro.cli import main
from repro.reporting.papers_claims import CLAIMS
from repro.reporting.samples import load_samples
from repro.runs.outputs import Outputs

pytestmark = pytest.mark.slow

TINY = (
    *("scale=first", "scale.pairs.train=16", "scale.pairs.val=4", "scale.pairs.test=8", "scale.max_epochs=1"),
    "exp=3",
)


def call(outputs, *words):
    command = [sys.executable, "run.py", f"outputs={outputs}", "runtime.accelerator=cpu", *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def outputs(tmp_path_factory):
    """Run a small study with its analysis: U-Net with and without decay and with another input."""
    outputs = tmp_path_factory.mktemp("page") / "first"
    call(outputs, *TINY, "decay=true,false", "hydra/launcher=basic", "-m")  # one process imports torch once
    call(outputs, *TINY, "encoding=stack4")
    for task in ("generalization", "report"):  # in this process, which has imported torch
        (checked,) = read_calls(*TINY, "runtime.accelerator=cpu", f"outputs={outputs}", f"task={task}")
        assert main.perform(checked) is None
    call(outputs, "task=analysis")  # the runs know their scale
    return outputs


def test_an_input_of_several_images_is_shown_as_the_projection(outputs):
    runs = [run for run in Outputs(outputs).runs() if run.config().encoding]
    samples = load_samples(Outputs(outputs), runs[0].config().experiment, runs)
    for sample in samples:
        assert sample["inputs"]["stack4"] == sample["inputs"]["projection"]
        assert sample["inputs"]["projection-no-decay"] != sample["inputs"]["projection"]


def test_baselines_alone_are_shown_beside_the_projection(outputs):
    runs = [run for run in Outputs(outputs).runs() if not run.config().encoding]
    samples = load_samples(Outputs(outputs), runs[0].config().experiment, runs)
    shown = samples[0]["predictions"].values()
    assert {prediction["input"] for prediction in shown} == {"projection"} == set(samples[0]["inputs"])


@pytest.fixture(scope="module")
def page(outputs):
    return (outputs / "report.html").read_text()


def test_the_analysis_writes_all_frames_and_figures(outputs):
    names = {path.stem for path in outputs.glob("analysis/*.csv")}
    assert names == {
        *("intervals", "differences", "recency", "obstacles", "calibration", "reliability", "cost"),
        *("audit", "claims", "generalization"),
    }
    figures = {path.stem for path in outputs.glob("analysis/*.png")}
    assert figures == {"recency", "obstacles", "reliability", "baselines", "encodings", "generalization"}
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


def test_the_page_is_well_formed_and_self_contained(page):
    outline = Outline()
    outline.feed(page)
    assert not outline.open
    assert len(set(outline.ids)) == len(outline.ids)
    assert all(link.startswith(("#", "data:")) for link in outline.links)
    assert {link[1:] for link in outline.links if link.startswith("#")} <= set(outline.ids)
    assert all(source.startswith("data:image/png;base64,") for source in outline.sources)
    assert not re.search(r"https?://", page)
    assert len(page) < 15_000_000


def test_the_page_has_every_claim_section_and_the_caption(page, outputs):
    assert '<a href="#generalization">Generalization under distribution shift</a>' in page
    assert f"python run.py task=analysis scale=first outputs={outputs}" in page
    assert "Scale first: 32 x 32 px, 16 training and 8 test pairs" in page
    for section in (
        "summary",
        "tables",
        "claims",
        "samples",
        "where",
        "calibration",
        "baselines",
        "generalization",
        "provenance",
    ):
        assert f'<section id="{section}">' in page


@pytest.mark.parametrize(("width", "scheme"), [(360, "light"), (1600, "dark")])
def test_the_page_works_in_a_browser_at_any_width(browser, outputs, width, scheme):
    tab = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
    errors, requests = [], []
    tab.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.on("request", lambda request: requests.append(request.url))
    tab.goto((outputs / "report.html").as_uri())
    tab.wait_for_function("document.getElementById('score').textContent.length > 0")
    assert tab.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    picture = "document.getElementById('error').toDataURL()"
    before, words = tab.evaluate(picture), tab.inner_text("#score")
    tab.focus("#threshold")
    for _ in range(8):
        tab.keyboard.press("ArrowRight")  # a little surer before free is believed
    tab.wait_for_function("document.getElementById('shown').value === '0.66'")
    tab.keyboard.press("End")  # hardly a pixel is free now, whatever the network has learned
    tab.wait_for_function(f"{picture} !== {before!r}")
    assert tab.inner_text("#score") != words
    kinds = tab.locator("#model option").all_inner_texts()
    assert {"U-Net", "U-Net, no decay", "U-Net, stack4", "Tracker"} <= set(kinds)
    seen = tab.evaluate("document.getElementById('input').toDataURL()")
    tab.select_option("#model", label="U-Net")  # the ablation is shown first
    tab.wait_for_function(f"document.getElementById('input').toDataURL() !== {seen!r}")
    tab.focus("#experiment")
    tab.keyboard.press("Tab")
    assert tab.evaluate("document.activeElement.id") == "model"
    assert not errors
    assert all(url.startswith(("file:", "data:", "blob:")) for url in requests)
    tab.close()
