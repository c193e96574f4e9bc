import pandas as pd
import pytest
from conftest import run_config

from repro.evaluation.metrics import METRICS
from repro.reporting.paper import read_paper
from repro.reporting.results import TRAINED, caption, compare, read_results
from repro.runs import prepare_run, run_directory, write_provenance


def fake_run(outputs, experiment, model, decay, seed, value, status="evaluated", **changes):
    """A run directory as evaluation leaves it, with every metric at one value."""
    run = run_directory(outputs, experiment, model, decay, seed)
    config = run_config(experiment=experiment, decay=decay, seed=seed, **changes)
    prepare_run(run, {**config, "model": {"name": model}})
    pd.DataFrame([dict.fromkeys(METRICS, value)]).to_csv(run / "metrics.csv", index=False)
    write_provenance(run, status=status, train_pairs=24, test_pairs=8, epochs=3, training_seconds=1.0)


def fake_study(outputs, seeds=(0,)):
    for seed in seeds:
        for rank, model in enumerate(TRAINED):
            fake_run(outputs, "3", model, True, seed, 0.5 + 0.1 * rank + 0.01 * seed)
    fake_run(outputs, "3", "all_free", True, 0, 0.9)


def test_every_metric_stands_beside_the_papers(tmp_path):
    fake_study(tmp_path)
    table = compare(read_results(tmp_path), decay=True)
    expected = ["experiment", "model", "decay", "seeds"]
    for metric in METRICS:
        expected += [metric, f"paper_{metric}", f"delta_{metric}"]
    assert list(table.columns) == expected
    assert table["model"].tolist() == [*TRAINED, "average", "all_free"]
    unet = table.iloc[0]
    paper = read_paper().query("model == 'unet' and experiment == '3' and decay").iloc[0]
    assert unet["paper_ssim"] == paper["ssim"]
    assert unet["delta_ssim"] == pytest.approx(0.5 - paper["ssim"])
    average = table.set_index("model").loc["average"]
    assert average["dice"] == pytest.approx(0.65)
    assert average["paper_specificity"] == 0.5485
    assert pd.isna(table.set_index("model").loc["all_free", "paper_dice"])


def test_several_seeds_give_mean_and_deviation(tmp_path):
    fake_study(tmp_path, seeds=(0, 1, 2))
    table = compare(read_results(tmp_path), decay=True).set_index("model")
    assert table.loc["unet", "seeds"] == table.loc["average", "seeds"] == 3
    assert table.loc["unet", "ssim"] == pytest.approx(0.51)
    assert table.loc["unet", "std_ssim"] == pytest.approx(0.01)
    assert table.loc["average", "std_ssim"] == pytest.approx(0.01)
    assert "seeds 0, 1, 2" in caption(read_results(tmp_path), "laptop")


def test_there_is_no_average_while_a_network_is_missing(tmp_path):
    fake_run(tmp_path, "3", "unet", True, 0, 0.5)
    fake_run(tmp_path, "3", "fpn", True, 0, 0.5)
    assert "average" not in compare(read_results(tmp_path), decay=True)["model"].tolist()


def test_ablation_and_main_do_not_mix(tmp_path):
    fake_run(tmp_path, "3", "unet", True, 0, 0.5)
    fake_run(tmp_path, "3", "unet", False, 0, 0.4)
    results = read_results(tmp_path)
    assert compare(results, decay=True)["ssim"].tolist() == [0.5]
    ablation = compare(results, decay=False)
    assert ablation["ssim"].tolist() == [0.4]
    assert ablation["paper_ssim"].tolist() == [0.6493]


def test_unfinished_runs_are_left_out(tmp_path):
    fake_run(tmp_path, "3", "unet", True, 0, 0.5)
    fake_run(tmp_path, "3", "fpn", True, 0, 0.5, status="failed")
    assert read_results(tmp_path)["model"].tolist() == ["unet"]


def test_resolutions_do_not_mix(tmp_path):
    fake_run(tmp_path, "3", "unet", True, 0, 0.5)
    fake_run(tmp_path, "3", "fpn", True, 0, 0.5, size_px=64)
    with pytest.raises(ValueError, match=r"differ in size_px: \[32, 64\]"):
        read_results(tmp_path)


def test_caption_says_what_the_table_is_from(tmp_path):
    fake_study(tmp_path)
    text = caption(read_results(tmp_path), "laptop")
    for fact in ("laptop", "32 x 32 px", "24 training", "8 test", " 3 epochs", "seed 0"):
        assert fact in text
