from repro.system import progress as module
from repro.system.progress import progress


def test_a_log_has_the_remaining_time_where_a_step_is_long_and_nothing_else(monkeypatch, capsys):
    assert sum(progress(range(3), "drawing")) == 3
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(module, "LOG_S", 0.0)
    with progress(description="tuning", total=4) as tried:
        tried.update(2)
    assert "tuning:  50%" in capsys.readouterr().err
