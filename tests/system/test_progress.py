import re

from repro.system import progress as module
from repro.system.progress import progress


def test_a_log_has_lines_with_the_remaining_time_where_a_step_is_long(monkeypatch, capsys):
    monkeypatch.setattr(module, "LINE_S", 0.0)
    assert list(progress(range(3), "drawing")) == [0, 1, 2]
    with progress(description="tuning", total=4) as tried:
        for _ in range(2):
            tried.update()
    lines = capsys.readouterr().err.splitlines()
    assert all(re.fullmatch(r"(drawing|tuning): \d of \d, [\d:]+ passed, [\d:?]+ left", line) for line in lines)
    assert [line.split(",")[0] for line in lines][-1] == "tuning: 2 of 4"


def test_a_short_step_prints_nothing(capsys):
    assert sum(progress(range(3), "drawing")) == 3
    assert capsys.readouterr().err == ""
