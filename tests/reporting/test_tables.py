import shutil

import pandas as pd
from conftest import fake_run, fake_study

from repro.metrics.names import TABLE_METRICS
from repro.reporting.results import read_results
from repro.reporting.tables import Table, write_tables
from repro.runs.outputs import Outputs


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


def test_a_table_of_deleted_runs_is_deleted(tmp_path):
    run = fake_run(tmp_path, "4", "unet", 0.4, decay=False)
    written(tmp_path)
    shutil.rmtree(run.path)
    fake_run(tmp_path, "4", "unet", 0.4)
    written(tmp_path)
    assert {path.stem for path in (tmp_path / "tables").iterdir()} == {"main"}


def test_empty_tables_say_that_no_run_is_evaluated(tmp_path):
    tables = written(tmp_path)
    assert all("No run evaluated yet" in table.to_markdown() for table in tables.values())
    assert not (tmp_path / "tables" / "main.csv").exists()


def test_a_metric_that_is_younger_than_published_results_is_left_empty():
    row = {"experiment": "3", "model": "unet", "encoding": "projection", "accuracy": 0.9, "paper_accuracy": 0.95}
    text = Table(pd.DataFrame([row]), "Old.").to_markdown()
    assert text.splitlines()[-1] == "| 3 | U-Net |  | 0.900 (0.950) |" + "  |" * (len(TABLE_METRICS) - 2)
