import json

import pandas as pd
import pytest
from conftest import ROOT
from test_results import fake_run, fake_study

from repro.publish import publish, readme_with_results
from repro.report import write_tables
from repro.results import read_results

RESULTS = ROOT / "reproduce" / "results"


def test_readme_and_published_results_agree():
    text = (ROOT / "README.md").read_text()
    assert "<!-- results:" in text
    assert readme_with_results(text, RESULTS) == text, "run `make readme`"


@pytest.mark.parametrize("directory", sorted(p for p in RESULTS.glob("*") if p.is_dir()), ids=lambda p: p.name)
def test_published_tables_follow_from_the_published_runs(directory):
    runs = pd.read_csv(directory / "runs.csv")
    origins = json.loads((directory / "provenance.json").read_text())
    assert len(runs) == len(origins)
    assert all(origin["status"] == "evaluated" and origin["recordings"] for origin in origins.values())
    for name, decay in (("main", True), ("ablation", False)):
        table = pd.read_csv(directory / f"{name}.csv")
        means = runs[runs["decay"] == decay].groupby(["experiment", "model"])["specificity"].mean()
        for row in table[table["model"] != "average"].itertuples():
            assert row.specificity == pytest.approx(means[row.experiment, row.model], abs=1e-4)


def test_publishing_copies_tables_runs_and_where_they_come_from(tmp_path):
    outputs, results = tmp_path / "laptop", tmp_path / "results"
    fake_study(outputs)
    fake_run(outputs, "3", "unet", False, 0, 0.4)
    target = publish(outputs, results)
    assert target == results / "laptop"
    names = {path.name for path in target.iterdir()}
    assert names == {"main.csv", "main.txt", "ablation.csv", "ablation.txt", "runs.csv", "provenance.json"}
    assert len(pd.read_csv(target / "runs.csv")) == len(read_results(outputs)) == 6
    assert "runs/exp3/unet/no-decay/seed0" in json.loads((target / "provenance.json").read_text())


def test_readme_tables_are_those_of_the_report(tmp_path):
    outputs = tmp_path / "laptop"
    fake_study(outputs)
    publish(outputs, tmp_path / "results")
    text = "before\n<!-- results: laptop main -->\nold\n<!-- end -->\nafter\n"
    made = readme_with_results(text, tmp_path / "results")
    assert made == f"before\n<!-- results: laptop main -->\n{write_tables(outputs)['main']}<!-- end -->\nafter\n"
    assert readme_with_results(made, tmp_path / "results") == made


def test_nothing_evaluated_cannot_be_published(tmp_path):
    with pytest.raises(ValueError, match="no network has been evaluated"):
        publish(tmp_path / "laptop", tmp_path / "results")
