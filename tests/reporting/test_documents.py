import pandas as pd
import pytest

from repro.reporting.documents import claims, methods, with_results


def markdown_of(make, intervals, **frames):
    """Return the lines of a table of the analysis; the first row is line 4."""
    return make({"intervals": intervals, **frames}, "Caption").to_markdown().splitlines()


def test_every_claim_has_its_row():
    judged = pd.DataFrame(
        [
            {"quote": "exp 3 is higher", "means": "accuracy", "verdict": "fails on the paper's tables",
             "ours": "reproduced", "value": 0.0512, "low": 0.04, "high": 0.06, "claimed": 0.0, "tolerance": 0.01,
             "paper": "fails", "paper_value": 0.07},
            {"quote": "hallucinations", "reason": "no test", "verdict": "cannot be tested", "ours": "cannot be tested"},
        ]
    )  # fmt: skip
    text = claims({"claims": judged}).to_markdown()
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
            ("unet", "series10", 0.6),
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
        *("| U-Net", "| U-Net, series10", "| another", "| mine", "| Tracker", "| Upper bound")
    ]
    assert lines[5].split(" | ")[1:3] == ["2", "0.600 [0.590, 0.610]"]
    assert lines[8].split(" | ")[1] == ""  # a baseline has no seeds
    assert lines[2].endswith("| Exp. 3: share of the bound |")
    assert [line.split(" | ")[-1] for line in lines[4:]] == ["0.62 |", "0.75 |", *["0.50 |"] * 2, "0.37 |", "1.00 |"]


def test_a_published_table_without_a_column_is_named(tmp_path):
    (path := tmp_path / "laptop" / "analysis").mkdir(parents=True)
    (path / "claims.csv").write_text("id,quote\na,b\n")
    with pytest.raises(ValueError, match=r"laptop: claims needs the table or column 'verdict': restore the CSV files"):
        with_results("<!-- results: laptop claims -->\n<!-- end -->\n", tmp_path)
