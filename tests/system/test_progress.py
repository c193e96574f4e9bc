from repro.system import progress as module
from repro.system.progress import progress, say


def test_a_log_has_lines_with_the_remaining_time_where_a_step_is_long_and_nothing_else(monkeypatch, capsys):
    assert sum(progress(range(3), "drawing")) == 3
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(module, "LOG_S", 0.0)
    with progress(description="tuning", total=4) as tried:
        tried.update(2)
    *_, last = capsys.readouterr().err.splitlines()
    assert last.startswith("tuning: 2 of 4 after 00:0")
    assert last.endswith("left")
    assert sum(progress(iter(range(3)), "predicting")) == 3
    assert "predicting: 3it" in capsys.readouterr().err


def test_a_line_is_written_in_one_piece(monkeypatch):
    pieces = []
    monkeypatch.setattr("sys.stdout.write", pieces.append)
    say("evaluating")
    assert pieces[0] == "evaluating\n"
