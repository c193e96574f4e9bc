import pytest

from repro.metrics.names import METRICS
from repro.reporting.paper import read_paper, targets


def test_tables_are_complete():
    table = read_paper()
    assert len(table) == 24 + 6
    assert not table.isna().any(axis=None)
    assert table.query("model == 'unet' and experiment == '1'")["specificity"].item() == 0.8443


def test_averages_are_the_means_of_the_rows():
    table = read_paper()
    means = table[table["model"] != "average"].groupby(["experiment", "encoding"])[list(METRICS)].mean()
    printed = table[table["model"] == "average"].set_index(["experiment", "encoding"])[list(METRICS)]
    assert (means - printed).abs().max(axis=None) < 1.01e-4  # its last digit


def test_targets_are_implied_by_the_tables():
    assert targets("1")["coverage"] == pytest.approx(0.100, abs=1e-3)
    assert targets("3")["coverage"] == pytest.approx(0.0834, abs=3e-4)
    assert targets("12") == {}
    assert targets("4") == pytest.approx({"coverage": 0.0845, "specificity": 0.5707}, abs=3e-4)
