import pytest
from conftest import ROOT, fake_run, fake_study

from repro.reporting.publish import publish
from repro.reporting.published_readme import Recipe
from repro.reporting.results import read_published
from repro.reporting.rows import read_rows
from repro.reporting.verification import verification_to_markdown, verify
from repro.runs.keys import KEY
from repro.runs.outputs import Outputs


@pytest.fixture
def published(tmp_path, monkeypatch):
    monkeypatch.setattr("repro.runs.provenance._commit", lambda: "0123abc")
    fake_study(tmp_path / "first" / "laptop", seeds=(0, 1))
    target = publish(Outputs(tmp_path / "first" / "laptop"), tmp_path / "results", Recipe("laptop"))
    monkeypatch.setattr("repro.runs.provenance._commit", lambda: "4567def")
    return target


def test_each_run_is_compared_with_its_published_counterpart(tmp_path, published):
    again = tmp_path / "again"
    for model, seed, value in (("unet", 0, 0.5), ("fpn", 0, 0.61), ("all_free", 0, 0.9), ("unet", 7, 0.5)):
        fake_run(again, "3", model, value, seed=seed)
    found = verify(Outputs(again), published).set_index("model")
    assert found["weights"].to_dict() == {"unet": "same", "fpn": "other", "all_free": ""}
    assert set(found["recordings"]) == {"same"}
    assert found["delta_accuracy"].to_dict() == pytest.approx({"unet": 0, "fpn": 0.01, "all_free": 0})
    assert found.loc["fpn", ["commit", "published_commit"]].tolist() == ["4567def", "0123abc"]
    text = verification_to_markdown(found.reset_index())
    assert "| 3 | FPN | 0 | same | other | 0.6100 (0.6000) |" in text
    assert "3 of 3 runs use the published recordings; 1 of 2 trainings have byte-identical weights" in text
    assert "Acc. 0.0100" in text


def test_other_recordings_are_reported(tmp_path, published):
    run = fake_run(tmp_path / "again", "3", "unet", 0.5)
    path = run.path / "provenance.json"
    path.write_text(path.read_text().replace("hash of recordings", "another hash"))
    assert verify(Outputs(tmp_path / "again"), published)["recordings"].tolist() == ["other"]


def test_runs_that_cannot_be_compared_are_refused(tmp_path, published):
    with pytest.raises(ValueError, match=r"no results are published in .*nowhere"):
        verify(Outputs(tmp_path / "first" / "laptop"), tmp_path / "nowhere")
    with pytest.raises(ValueError, match=r"none of the 9 runs in .* is evaluated in .*empty"):
        verify(Outputs(tmp_path / "empty"), published)
    fake_run(tmp_path / "coarse", "3", "unet", 0.5, size_px=16)
    with pytest.raises(ValueError, match=r"the published runs have 32 px, the runs in .*coarse have 16"):
        verify(Outputs(tmp_path / "coarse"), published)


@pytest.mark.parametrize("path", sorted((ROOT / "reproduce" / "results").glob("*/verification.csv")), ids=str)
def test_published_verifications_found_identical_weights_and_metrics(path):
    found, runs = read_rows(path), read_published(path.parent)
    both = found.merge(runs, on=KEY, suffixes=("", "_of_run"))
    assert len(both) == len(found) > 0
    assert (both["published_accuracy"] - both["accuracy_of_run"]).abs().max() < 1e-6
    assert set(found["recordings"]) == set(found["weights"].dropna()) == {"same"}
    assert found.filter(like="delta_").abs().max(axis=None) == 0
