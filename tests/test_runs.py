import json

import pytest
from conftest import run_config

from repro.runs import (
    prepare_run,
    read_config,
    read_provenance,
    read_status,
    run_directory,
    write_provenance,
)


def test_directories_are_named_by_what_the_run_is(tmp_path):
    assert run_directory(tmp_path, "3", "unet", True, 0) == tmp_path / "runs/exp3/unet/decay/seed0"
    assert run_directory(tmp_path, "4", "fpn", False, 2) == tmp_path / "runs/exp4/fpn/no-decay/seed2"


def test_the_same_configuration_may_come_again(tmp_path):
    prepare_run(tmp_path, run_config())
    prepare_run(tmp_path, run_config())
    assert read_config(tmp_path) == run_config()


def test_another_configuration_is_refused_naming_the_difference(tmp_path):
    prepare_run(tmp_path, run_config())
    with pytest.raises(ValueError, match=r"data\.size_px is 32, asked for 64; train\.patience is 5, asked for 3"):
        prepare_run(tmp_path, run_config(size_px=64, patience=3))
    assert read_config(tmp_path) == run_config()


def test_no_run_directory_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"no run directory: it has no config\.yaml"):
        read_config(tmp_path)


def test_provenance_gathers_facts_and_says_where_they_come_from(tmp_path):
    assert read_status(tmp_path) is None
    write_provenance(tmp_path, status="failed", error="the loss is nan")
    assert read_provenance(tmp_path)["error"] == "the loss is nan"
    write_provenance(tmp_path, status="finished", epochs=3)
    write_provenance(tmp_path, status="evaluated", test_pairs=8)
    found = json.loads((tmp_path / "provenance.json").read_text())
    assert found["status"] == "evaluated"
    assert (found["epochs"], found["test_pairs"]) == (3, 8)
    assert "error" not in found
    assert found["versions"]["ir-sim"] == "2.12.0"
    assert found["hardware"]["cpu_cores"] > 0
