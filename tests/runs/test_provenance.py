import json
import re
import subprocess

import pytest
from conftest import ROOT, fake_run

from repro.runs import provenance
from repro.runs.provenance import _commit  # not that of the fixture, which reads it once
from repro.system.errors import InputError


@pytest.fixture
def repository(tmp_path):
    """Create somebody else's repository with a commit."""
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b"]
    for arguments in (["init", "-q"], ["commit", "-q", "--allow-empty", "-m", "theirs"]):
        subprocess.run([*git, *arguments], check=True)
    return tmp_path


@pytest.mark.parametrize("place", ["copy", "venv/lib/python3.11/site-packages/repro"])
@pytest.mark.parametrize("stated", ["a1b2c3", None])
def test_code_inside_another_repository_has_not_its_commit(repository, monkeypatch, place, stated):
    (repository / place).mkdir(parents=True)
    monkeypatch.setattr(provenance, "project_directory", lambda: repository / place)
    monkeypatch.delenv("REPRO_COMMIT", raising=False)
    if stated:
        monkeypatch.setenv("REPRO_COMMIT", stated)
    assert _commit() == stated


def test_a_checkout_has_its_own_commit(monkeypatch):
    if not (ROOT / ".git").exists():
        pytest.skip("this is no checkout")
    monkeypatch.setenv("REPRO_COMMIT", "a1b2c3")
    assert re.fullmatch(r"[0-9a-f]{40}\+?", str(_commit()))


def test_a_run_that_is_done_names_another_commit_of_its_code(tmp_path, monkeypatch):
    run = fake_run(tmp_path, "3", "unet", 0.5)
    monkeypatch.setattr(provenance, "_commit", lambda: run.provenance().last("trained")["commit"])
    assert run.done == str(run)
    monkeypatch.setattr(provenance, "_commit", lambda: "0123456789abcdef")
    assert "now 01234567: delete the run to train it again)" in run.done


@pytest.mark.parametrize(
    "step", [{"step": 1}, {}, {"step": "trained", "files": "all"}, {"step": "trained", "commit": 7}, {"step": None}]
)
def test_steps_of_another_type_are_refused(step, tmp_path):
    run = fake_run(tmp_path, "3", "unet", 0.5)
    path = run.path / "provenance.json"
    path.write_text(json.dumps({"status": "evaluated", "steps": [step]}))
    with pytest.raises(InputError, match=r"provenance.json cannot be read \(.*a step has"):
        run.provenance()
