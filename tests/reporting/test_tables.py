import dataclasses
import shutil

import pandas as pd
import pytest
from conftest import fake_run, fake_study, run_config

from repro.metrics.headings import METRICS, TABLE_METRICS
from repro.reporting.paper import read_paper, targets
from repro.reporting.results import read_results
from repro.reporting.tables import Table, caption, compare_with_paper, make_tables, missing, not_shown, write_tables
from repro.runs.config import PROJECTION, PROJECTION_NO_DECAY, EncodingChoice
from repro.runs.model import NETWORKS
from repro.runs.outputs import Outputs

SERIES = EncodingChoice("series10", {"frames": 10, "range_max_m": 30.0})


def test_every_metric_is_compared_with_the_papers(tmp_path):
    fake_study(tmp_path)
    table = compare_with_paper(read_results(Outputs(tmp_path)), PROJECTION)
    expected = ["experiment", "model", "encoding", "seeds"]
    for metric in TABLE_METRICS:
        expected += [metric, f"paper_{metric}", f"delta_{metric}"]
    assert list(table.columns) == expected
    assert table["model"].tolist() == [*NETWORKS, "average", "all_free"]
    unet = table.iloc[0]
    paper = read_paper().query("model == 'unet' and experiment == '3' and encoding == @PROJECTION").iloc[0]
    assert unet["paper_ssim"] == paper["ssim"]
    assert unet["delta_ssim"] == pytest.approx(0.5 - paper["ssim"])
    average = table.set_index("model").loc["average"]
    assert average["dice"] == pytest.approx(0.65)
    assert average["paper_specificity"] == 0.5485
    assert pd.isna(table.set_index("model").loc["all_free", "paper_dice"])


def test_several_seeds_give_mean_and_deviation(tmp_path):
    fake_study(tmp_path, seeds=(0, 1, 2))
    table = compare_with_paper(read_results(Outputs(tmp_path)), PROJECTION).set_index("model")
    assert table.loc["unet", "seeds"] == table.loc["average", "seeds"] == 3
    assert table.loc["unet", "ssim"] == pytest.approx(0.51)
    assert table.loc["unet", "std_ssim"] == pytest.approx(0.01)
    assert table.loc["average", "std_ssim"] == pytest.approx(0.01)
    assert "seeds 0, 1, 2" in caption(read_results(Outputs(tmp_path)))


def test_resolutions_do_not_mix(tmp_path):
    fake_run(tmp_path, "3", "unet", 0.5)
    fake_run(tmp_path, "3", "fpn", 0.5, size_px=64)
    with pytest.raises(ValueError, match=r"fpn.* has other data than .*unet.*\(size_px is 64, requested 32\)"):
        read_results(Outputs(tmp_path))


def test_the_caption_has_scale_size_pairs_epochs_and_seeds(tmp_path):
    fake_study(tmp_path)
    facts = "Scale laptop: 32 x 32 px, 24 training and 8 test pairs per experiment, 3 epochs,"
    assert caption(read_results(Outputs(tmp_path))) == f"{facts} seed 0."
    fake_run(tmp_path, "3", "unet", 0.5, seed=1)
    assert caption(read_results(Outputs(tmp_path))) == f"{facts} seeds 0, 1 (1 to 2 per cell)."


def test_the_cells_of_the_paper_that_have_no_run_are_named(tmp_path):
    fake_run(tmp_path, "3", "convgru", 0.7, encoding=EncodingChoice("series10", {"frames": 10}))
    assert missing(read_results(Outputs(tmp_path)), PROJECTION) == "", "not a study of the paper's networks"
    for experiment in "34":
        fake_run(tmp_path, experiment, "unet", 0.5)
    fake_run(tmp_path, "1", "fpn", 0.5)
    expected = " Not trained: U-Net in exp 1, 2; FPN in exp 2, 3, 4; UPerNet, Segformer."
    assert missing(read_results(Outputs(tmp_path)), PROJECTION) == expected
    for experiment in "1234":
        for model in NETWORKS:
            fake_run(tmp_path, experiment, model, 0.5)
    assert missing(read_results(Outputs(tmp_path)), PROJECTION) == ""
    assert missing(read_results(Outputs(tmp_path)), PROJECTION_NO_DECAY) == ""


def test_our_best_network_has_a_row_below_the_papers(tmp_path):
    fake_study(tmp_path)
    fake_run(tmp_path, "3", "convgru", 0.7, encoding=EncodingChoice("series10", {"frames": 10}))
    assert not not_shown(read_results(Outputs(tmp_path)))
    fake_run(tmp_path, "3", "unet", 0.6, encoding=EncodingChoice("series10", {"frames": 10}))
    results = read_results(Outputs(tmp_path))
    main = make_tables(results)["main"]
    assert main.frame["model"].tolist() == [*NETWORKS, "average", "convgru", "all_free"]
    ours = main.frame[main.frame["encoding"] == "series10"].iloc[0]
    assert ours["dice"] == 0.7
    assert pd.isna(ours["paper_dice"])
    assert not_shown(results) == "Evaluated, but in the tables of task=analysis only: U-Net, series10."


def test_a_network_that_was_trained_differently_is_marked(tmp_path):
    """A network of one's own is not compared by its encoder."""
    fake_study(tmp_path)
    fake_run(tmp_path, "3", "dilated", 0.5, encoder_name=None, parameters={"hidden": 8})
    fake_run(tmp_path, "4", "unet", 0.5)
    assert "Not trained like the others" not in caption(read_results(Outputs(tmp_path)))
    fake_run(tmp_path, "4", "fpn", 0.5, train=dataclasses.replace(run_config().train, learning_rate=0.5))
    text = caption(read_results(Outputs(tmp_path)))
    assert text.endswith("Not trained like the others: FPN in exp 4 (train.learning_rate=0.5).")


def test_seeds_with_different_settings_are_not_averaged(tmp_path):
    """The main table would show their mean as that of one network."""
    fake_run(tmp_path, "3", "convgru", 0.5, parameters={"hidden": 48})
    other = run_config(experiment="3", model="convgru", seed=1, parameters={"hidden": 16})
    message = "model.parameters.hidden is 48, requested 16"
    with pytest.raises(ValueError, match=rf"seed0, another seed, has other settings \({message}\)"):
        Outputs(tmp_path).check_data(other)
    fake_run(tmp_path, "3", "convgru", 0.7, seed=1, parameters={"hidden": 16})
    with pytest.raises(ValueError, match=r"settings \(model.parameters.hidden is 48, requested 16\): move or delete"):
        read_results(Outputs(tmp_path))


def test_runs_of_altered_worlds_are_not_compared_with_the_paper(tmp_path):
    for experiment in "123":
        fake_run(tmp_path, experiment, "convgru", 0.5, worlds="faster obstacles", encoding=SERIES)
    fake_run(tmp_path, "3", "unet", 0.5, worlds="faster obstacles")
    fake_run(tmp_path, "4", "unet", 0.5)
    results = read_results(Outputs(tmp_path))
    table = compare_with_paper(results, PROJECTION).query("model == 'unet'").set_index("experiment")
    assert table["paper_accuracy"].isna().to_dict() == {"3": True, "4": False}
    assert "Not the paper's worlds: exp 3." in caption(results)


def test_a_network_of_the_user_has_a_row_for_every_input_but_those_without_decay(tmp_path):
    fake_run(tmp_path, "3", "unet", 0.5)
    series = EncodingChoice("series10", {"frames": 10})
    for changes in ({}, {"encoding": series}, {"encoding": EncodingChoice("stack4", {"frames": 4, "decay": False})}):
        fake_run(tmp_path, "3", "mynet", 0.6, **changes)
    fake_run(tmp_path, "3", "convlstm", 0.6, encoding=series)
    results = read_results(Outputs(tmp_path))
    tables = make_tables(results)
    rows = [line.split(" | ")[1] for line in tables["main"].to_markdown().splitlines() if line.startswith("| 3")]
    assert rows == ["U-Net", "mynet", "mynet, series10"]
    assert not_shown(results).endswith("task=analysis only: ConvLSTM, series10; mynet, stack4, no decay.")


def written(path):
    """Write the tables of an outputs directory."""
    return write_tables(path / "tables", read_results(Outputs(path)))


def test_both_tables_are_written(tmp_path):
    fake_study(tmp_path)
    fake_run(tmp_path, "4", "unet", 0.4, decay=False)
    tables = written(tmp_path)
    files = {path.name for path in (tmp_path / "tables").iterdir()}
    assert files == {f"{name}.{suffix}" for name in ("main", "ablation") for suffix in ("csv", "md")}
    assert len(pd.read_csv(tmp_path / "tables" / "main.csv")) == 6
    assert "| 3 | U-Net | 0.500 (0.663) |" in tables["main"].to_markdown()
    assert "| 3 | All free | 0.900 |" in tables["main"].to_markdown()
    assert "Scale laptop" in tables["ablation"].caption
    shutil.rmtree(tmp_path / "runs" / "exp4")
    tables = written(tmp_path)
    assert "No run evaluated yet" in tables["ablation"].to_markdown()
    assert {path.stem for path in (tmp_path / "tables").iterdir()} == {"main"}


def test_a_metric_that_is_younger_than_published_results_is_left_empty():
    row = {"experiment": "3", "model": "unet", "encoding": "projection", "accuracy": 0.9, "paper_accuracy": 0.95}
    text = Table(pd.DataFrame([row]), "Old.").to_markdown()
    assert text.splitlines()[-1] == "| 3 | U-Net |  | 0.900 (0.950) |" + "  |" * (len(TABLE_METRICS) - 2)


def test_the_papers_tables_are_complete_and_their_averages_are_means():
    table = read_paper()
    assert len(table) == 24 + 6
    assert not table.isna().any(axis=None)
    means = table[table["model"] != "average"].groupby(["experiment", "encoding"])[list(METRICS)].mean()
    printed = table[table["model"] == "average"].set_index(["experiment", "encoding"])[list(METRICS)]
    assert (means - printed).abs().max(axis=None) < 1.01e-4  # its last digit


def test_targets_are_implied_by_the_tables():
    assert targets("1")["coverage"] == pytest.approx(0.100, abs=1e-3)
    assert targets("3")["coverage"] == pytest.approx(0.0834, abs=3e-4)
    assert targets("12") == {}
    assert targets("4") == pytest.approx({"coverage": 0.0845, "specificity": 0.5707}, abs=3e-4)
