import shutil

import pandas as pd
from conftest import fake_run, fake_study

from repro.metrics.names import TABLE_METRICS
from repro.reporting.tables import Table, costs_to_markdown, write_tables
from repro.runs.outputs import Outputs


def test_three_forms_of_both_tables(tmp_path):
    fake_study(tmp_path)
    fake_run(tmp_path, "4", "unet", 0.4, decay=False)
    tables = write_tables(Outputs(tmp_path))
    files = {path.name for path in (tmp_path / "tables").iterdir()}
    assert files == {f"{name}.{suffix}" for name in ("main", "ablation") for suffix in ("csv", "md", "tex")}
    assert len(pd.read_csv(tmp_path / "tables" / "main.csv")) == 6
    assert "| 3 | U-Net | 0.500 (0.663) |" in tables["main"].to_markdown()
    assert "| 3 | All free | 0.900 |" in tables["main"].to_markdown()
    assert "Scale laptop" in tables["ablation"].caption


def test_a_table_of_deleted_runs_is_deleted(tmp_path):
    run = fake_run(tmp_path, "4", "unet", 0.4, decay=False)
    write_tables(Outputs(tmp_path))
    shutil.rmtree(run.path)
    fake_run(tmp_path, "4", "unet", 0.4)
    write_tables(Outputs(tmp_path))
    assert {path.stem for path in (tmp_path / "tables").iterdir()} == {"main"}


def test_latex_has_all_columns_in_every_row_and_the_paper_below_ours(tmp_path):
    fake_study(tmp_path)
    write_tables(Outputs(tmp_path))
    text = (tmp_path / "tables" / "main.tex").read_text()
    rows = [line for line in text.splitlines() if line.endswith(r"\\") and "multicolumn" not in line]
    assert rows
    assert all(row.count("&") == 2 * len(TABLE_METRICS) for row in rows)
    ours = next(k for k, row in enumerate(rows) if row.startswith("U-Net"))
    assert "0.5000" in rows[ours]
    assert r"\emph{paper}" in rows[ours + 1]
    assert "0.5950" in rows[ours + 1]
    assert text.count("{") == text.count("}")


def test_empty_tables_say_that_no_run_is_evaluated(tmp_path):
    tables = write_tables(Outputs(tmp_path))
    assert all("No run evaluated yet" in table.to_markdown() for table in tables.values())
    assert not (tmp_path / "tables" / "main.csv").exists()


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
    page = costs_to_markdown(Table(table, "Costs of the networks.")).splitlines()
    assert page[0] == "**Costs of the networks.**"
    assert page[2:4] == ["| Model | Image [px] | Parameters [M] | CPU, ONNX Runtime [ms] |", "|---|---|---|---|"]
    assert page[4:] == ["| U-Net | 64 | 5.55 | 12.3 |", "| FPN | 64 | 5.07 |  |"]


def test_latex_has_every_experiment_also_a_new_one(tmp_path):
    for experiment in ("1", "3", "ground_floor"):
        fake_run(tmp_path, experiment, "unet", 0.5)
    fake_run(tmp_path, "1", "my_network", 0.5)
    write_tables(Outputs(tmp_path))
    text = (tmp_path / "tables" / "main.tex").read_text()
    for title in (
        "Experiment 1 (Static, rotation)",
        "Experiment 3 (Dynamic, rotation)",
        r"{Experiment ground\_floor}",
        r"my\_network &",
    ):
        assert text.count(title) == 1
    rows = [line for line in text.splitlines() if line.endswith(r"\\") and "multicolumn" not in line]
    assert all(row.count("&") == 2 * len(TABLE_METRICS) for row in rows)


def test_a_metric_that_is_younger_than_published_results_is_left_empty():
    row = {"experiment": "3", "model": "unet", "encoding": "projection", "accuracy": 0.9, "paper_accuracy": 0.95}
    text = Table(pd.DataFrame([row]), "Old.").to_markdown()
    assert text.splitlines()[-1] == "| 3 | U-Net |  | 0.900 (0.950) |" + "  |" * (len(TABLE_METRICS) - 2)
