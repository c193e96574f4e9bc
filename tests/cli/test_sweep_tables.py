from conftest import fake_run

from repro.cli.output import print_tables
from repro.runs.outputs import Outputs


def test_runs_that_cannot_share_a_table_are_an_error_of_the_call(tmp_path, capsys):
    fake_run(tmp_path, "3", "unet", 0.5)
    fake_run(tmp_path, "3", "fpn", 0.5, size_px=64)
    (error,) = print_tables(Outputs(tmp_path), ("main",))
    assert "differ in size_px (32, 64)" in error
    assert error in capsys.readouterr().err
