import pandas as pd
import pytest

from repro.reporting.documents import bounds, claims, costs, methods, networks, with_results
from repro.reporting.page import across


def markdown_of(make, intervals, **frames):
    """Return the lines of a table of the analysis; the first row is line 4."""
    return make({"intervals": intervals, **frames}, "Caption").to_markdown().splitlines()


def test_every_claim_has_its_row_and_every_verdict_its_count():
    judged = pd.DataFrame(
        [
            {"quote": "exp 3 is higher", "means": "accuracy", "verdict": "fails on the paper's tables",
             "ours": "reproduced", "value": 0.0512, "low": 0.04, "high": 0.06, "claimed": 0.0, "tolerance": 0.01,
             "paper": "fails", "paper_value": 0.07},
            {"quote": "hallucinations", "reason": "no test", "verdict": "cannot be tested", "ours": "cannot be tested"},
        ]
    )  # fmt: skip
    text = claims({"claims": judged})
    assert "**1 fails on the paper's own tables, 1 cannot be tested.**" in text
    own = "fails on the paper's tables | reproduced | 0.051 [0.040, 0.060] (0 ± 0.01) | fails, 0.070 |"
    assert f"| exp 3 is higher | accuracy | {own}" in text
    assert "| hallucinations | no test | cannot be tested | cannot be tested |  |  |" in text


def test_methods_are_in_the_order_of_the_tables_with_intervals():
    rows = [
        (experiment, model, encoding, metric, value, value - 0.01, value + 0.01, 2)
        for experiment in ("3", "4")
        for model, encoding, value in (
            ("tracker", "", 0.3),
            ("mine", "projection", 0.4),
            ("another", "projection", 0.4),
            ("unet", "observed_free", 0.6),
            ("unet", "projection", 0.5),
        )
        for metric in ("accuracy", "specificity", "obstacle_iou", "ssim")
    ]
    rows += [("3", "privileged", "", "obstacle_iou", 0.8, 0.79, 0.81, 1)]
    rows += [("1", "unet", "projection", "accuracy", 0.9, 0.9, 0.9, 2)]
    columns = ["experiment", "model", "encoding", "metric", "value", "low", "high", "seeds"]
    lines = markdown_of(methods, pd.DataFrame(rows, columns=columns))
    assert lines[0] == "**Caption**"
    assert lines[2].count("Exp. 3") == lines[2].count("Exp. 4") + 1 == 4
    assert [line.split(" | ")[0] for line in lines[4:]] == [
        *("| U-Net", "| U-Net, observed_free", "| another", "| mine", "| Tracker", "| Upper bound")
    ]
    assert lines[5].split(" | ")[1:3] == ["2", "0.600 [0.590, 0.610]"]
    assert lines[8].split(" | ")[1] == ""  # a baseline has no seeds
    assert lines[2].endswith("| Exp. 3: share of the bound |")
    assert [line.split(" | ")[-1] for line in lines[4:]] == ["0.62 |", "0.75 |", *["0.50 |"] * 2, "0.37 |", "1.00 |"]


def test_networks_are_shown_with_their_share_of_the_bound_and_costs():
    intervals = pd.DataFrame(
        [
            ("3", "unet", "projection", "obstacle_iou", 0.4),
            ("3", "convgru", "series10", "obstacle_iou", 0.6),
            ("3", "privileged", "", "obstacle_iou", 0.8),
            ("4", "unet", "projection", "obstacle_iou", 0.5),
        ],
        columns=["experiment", "model", "encoding", "metric", "value"],
    )
    calibration = pd.DataFrame(
        [
            ("3", "unet", "projection", "all", 0.15),
            ("3", "unet", "projection", "1-10", 0.1),
        ],
        columns=["experiment", "model", "encoding", "recency", "log_loss"],
    )
    measured = pd.DataFrame(
        [("unet", "projection", 64, 5.55, 3.4, 6.2), ("convgru", "series10", 64, 0.155, 5.2, 8.8)],
        columns=["model", "encoding", "size_px", "parameters_m", "training_min", "cpu_onnx_ms"],
    )
    lines = markdown_of(networks, intervals, calibration=calibration, costs=measured)
    assert lines[4] == "| U-Net | 0.400 | 0.50 | 0.150 | 0.500 |  |  | 5.55 | 3.4 | 6 |"
    assert lines[5] == "| ConvGRU, series10 | 0.600 | 0.75 |  |  |  |  | 0.15 | 5.2 | 9 |"


def test_bounds_are_shown_by_experiment_with_their_probabilistic_measures():
    columns = ["experiment", "model", "encoding", "metric", "value", "low", "high"]
    scored = [
        (experiment, name, "", metric, value, value - 0.01, value + 0.01)
        for experiment in ("3", "4")
        for name, value in (("privileged", 0.8), ("positions", 0.5), ("tracker", 0.3))
        for metric in ("accuracy", "specificity", "obstacle_iou")
    ]
    measured = [
        ("4", "privileged", "", recency, "log_loss", value, value, value)
        for recency, value in (("all", 0.04), ("1-10", 0.01))
    ]
    recency = pd.DataFrame(measured, columns=[*columns[:3], "recency", *columns[3:]])
    lines = markdown_of(bounds, pd.DataFrame(scored, columns=columns), recency=recency)
    titles = [line.split(" | ")[:2] for line in lines[4:]]
    names = ["Upper bound", "Upper bound, positions only"]
    assert titles == [[f"| {experiment}", name] for experiment in ("3", "4") for name in names]
    assert "0.040 [0.040, 0.040]" in lines[6]
    assert lines[4].count("0.800 [0.790, 0.810]") == 3


def test_a_published_table_without_a_column_is_named(tmp_path):
    (path := tmp_path / "laptop" / "analysis").mkdir(parents=True)
    (path / "claims.csv").write_text("id,quote\na,b\n")
    with pytest.raises(ValueError, match=r"laptop: claims needs the table or column 'value': restore the CSV files"):
        with_results("<!-- results: laptop claims -->\n<!-- end -->\n", tmp_path)


def test_a_network_may_be_tested_on_more_experiments_than_another():
    rows = [("1", "1"), ("1", "3"), ("3", "3")]
    frame = pd.DataFrame(rows, columns=["trained", "tested"]).assign(shift="experiment", model="unet", seed=0)
    frame = frame.assign(encoding="projection", value=0.5)
    frame = pd.concat([frame.assign(metric=metric) for metric in ("accuracy", "obstacle_iou")])
    (table,) = across(frame)
    assert table.heads == ["Trained on", "tested on 1", "tested on 3"]
    assert table.rows == [["1", "0.500 / 0.500", "0.500 / 0.500"], ["3", "", "0.500 / 0.500"]]


def test_the_costs_table_leaves_out_unmeasured_columns():
    table = pd.DataFrame(
        {
            "model": ["unet", "fpn"],
            "size_px": [64, 64],
            "parameters_m": [5.5512, 5.07],
            "cuda_eager_ms": [None, None],
            "cpu_onnx_ms": [12.34, None],
        }
    )
    page = costs(table, "Costs of the networks.").to_markdown().splitlines()
    assert page[0] == "**Costs of the networks.**"
    assert page[2:4] == ["| Model | Image [px] | Parameters [M] | CPU, ONNX Runtime [ms] |", "|---|---|---|---|"]
    assert page[4:] == ["| U-Net | 64 | 5.55 | 12.3 |", "| FPN | 64 | 5.07 |  |"]
