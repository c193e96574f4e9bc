"""README.md, CONTRIBUTING.md and docs/: tables agree with the results, links exist, commands and recipes run."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, TINY, read_calls

from repro.logs.formats import read_log
from repro.logs.options import ReadOptions, WindowSettings
from repro.reporting import page
from repro.reporting.documents import with_results

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "DEVIATIONS.md", *sorted((ROOT / "docs").glob("*.md"))]
TABLES = sorted((ROOT / "reproduce" / "results").glob("*/tables.md"))
ABLATION = "python run.py -m model=unet,fpn,upernet,segformer exp=3,4 decay=false"
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
QUICK = """
sed -i 's/  workers: 2/  workers: 1/; s/${default_launcher:}/basic/' conf/config.yaml
echo 'TRACKER = {name: values[2:3] for name, values in TRACKER.items()}' >> src/repro/baselines/registry.py
"""
EXTENDING = ROOT / "docs" / "extending.md"
RECIPE = re.compile(r"^### (.+?)\n(.*?)(?=^##|\Z)", re.DOTALL | re.MULTILINE)


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


def recipes() -> dict[str, str]:
    """The recipes of docs/extending.md by title: sections with blocks that say which file they change."""
    sections = RECIPE.findall(EXTENDING.read_text())
    return {title: text for title, text in sections if "# file:" in text or "# replace in:" in text}


def copy_of_the_project(directory: Path) -> Path:
    """Copy the project without its results and environment, with its compiled loops."""
    ignored = shutil.ignore_patterns(".venv*", "outputs", ".git", ".*_cache", "results", "*.egg-info")
    return Path(shutil.copytree(ROOT, directory / "project", ignore=ignored, symlinks=True))


def apply(text: str, project: Path) -> list[str]:
    """Apply the blocks of a recipe to a copy of the project; return its scripts."""
    scripts = []
    for language, block in BLOCK.findall(text):
        first, _, body = block.partition("\n")
        change = re.match(r"# (file|replace in): (\S+)", first)
        if language == "bash":
            scripts.append(block)
        elif change:
            path = project / change[2]
            if change[1] == "file":
                assert not path.exists(), path
                path.write_text(body)
            else:
                for old, new in re.findall(r"^<<<<\n(.*?)\n====\n(.*?)\n>>>>", body, re.DOTALL | re.MULTILINE):
                    content = path.read_text()
                    assert content.count(old) == 1, f"{path} has {old!r} {content.count(old)} times"
                    path.write_text(content.replace(old, new))
    return scripts


def run_script(script: str, project: Path, python: Path) -> str:
    """Run a script of bash, stopping at the first error."""
    path = os.pathsep.join([str(python.parent), str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(project / "src")}
    command = ["bash", "-euo", "pipefail", "-c", script]
    done = subprocess.run(command, cwd=project, env=environment, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, f"{script}\n{done.stdout[-2000:]}{done.stderr[-3000:]}"
    return done.stdout


def run_command(command: str, outputs: Path, python: Path) -> str:
    """Run a documented command line at a tiny size."""
    words = re.sub(r"\b(scale|outputs)=\S+", "", command)
    if " -m " in words and "launcher" not in words:
        words += " hydra/launcher=basic"  # one process imports torch once
    tiny = TINY[:5] if "task=" in words else TINY
    return run_script(f"{words} {' '.join(tiny)} outputs={outputs}", ROOT, python)


@pytest.mark.parametrize("page", [PAGES[0], *TABLES], ids=named)
def test_generated_tables_are_those_of_the_published_results(page):
    text = page.read_text()
    assert with_results(text, ROOT / "reproduce" / "results") == text, "run `make docs`"


def test_the_page_of_published_results_is_made_by_the_command_of_their_readme(tmp_path, monkeypatch):
    text = (ROOT / "reproduce" / "results" / "README.md").read_text()
    (words,) = re.findall(r"^python -m repro\.reporting\.page (\S+) (\S+)$", text, re.MULTILINE)
    monkeypatch.chdir(ROOT)
    page.main([words[0], str(tmp_path / words[1])])
    html = (tmp_path / words[1]).read_text()
    assert "Scale workstation: 128 x 128 px" in html
    assert html.count("<figure>") >= 6
    assert not list((ROOT / "reproduce").rglob("*.html")), "pages are made, not stored"
    with pytest.raises(SystemExit, match=r"paper has no claims and no intervals\.csv"):
        page.main(["reproduce/results/paper", str(tmp_path / "none.html")])


@pytest.mark.parametrize("page", [*PAGES, *TABLES], ids=named)
def test_relative_links_exist(page):
    targets = [link for link in LINK.findall(page.read_text()) if "://" not in link and not link.startswith("mailto:")]
    missing = [link for link in targets if not (page.parent / link).exists()]
    assert not missing


def test_the_readme_is_short():
    text = re.sub(r"<!-- results:.*?<!-- end -->", "", (ROOT / "README.md").read_text(), flags=re.DOTALL)
    assert len(text.split()) <= 750


def test_the_converter_of_a_csv_file_makes_a_log(tmp_path, monkeypatch):
    (code,) = [code for _, code in BLOCK.findall((ROOT / "docs" / "robot.md").read_text()) if "loadtxt" in code]
    log = read_log(ROOT / "examples" / "rooms.npz", WindowSettings(), ReadOptions())
    monkeypatch.chdir(tmp_path)
    rows = np.column_stack([log.stamps, log.poses, log.ranges])
    np.savetxt("scans.csv", rows, delimiter=",", header="time,x,y,heading,ranges")
    exec(compile(code, "docs/robot.md", "exec"), {})
    found = read_log(tmp_path / "scans.npz", WindowSettings(), ReadOptions())
    for name in ("stamps", "poses", "ranges", "angles", "range_max_m"):
        assert getattr(found, name) == pytest.approx(getattr(log, name), abs=1e-6)


def test_there_is_a_recipe_for_every_extension():
    titles = " ".join(recipes()).lower()
    assert all(word in titles for word in ("world", "motion", "encoding", "network", "baseline", "metric")), titles


@pytest.mark.slow
@pytest.mark.parametrize("title", recipes())
def test_recipe(title, tmp_path, python):
    project = copy_of_the_project(tmp_path)
    scripts = apply(recipes()[title], project)
    assert scripts, "a recipe ends with a command that uses it"
    (tiny,) = apply(EXTENDING.read_text().partition("###")[0], project)
    run_script("ruff check --quiet . && ruff format --quiet --check .", project, python)
    for script in (QUICK, *(tiny + script for script in scripts)):
        run_script(script, project, python)


def documented_commands() -> list[str]:
    """The commands of the documentation that use run.py, once each."""
    blocks = [block for path in PAGES if path.name != "extending.md" for _, block in BLOCK.findall(path.read_text())]
    lines = [line.split(" #")[0].strip() for block in blocks for line in block.splitlines()]
    return list(dict.fromkeys(line for line in lines if line.startswith("python run.py")))


@pytest.fixture(scope="module")
def outputs(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("documented") / "first"


def runnable() -> dict[bool, list[str]]:
    """The documented commands that need no published results, cluster or map, by whether other tests run the like.

    Those of docs/running.md, and the ablation that tests/cli/test_pipeline.py runs as written, are only composed.
    """
    tested, needs = (ROOT / "docs" / "running.md").read_text() + ABLATION, ("slurm", "first_floor")
    commands = [command for command in documented_commands() if not any(word in command for word in needs)]
    return {known: [command for command in commands if (command in tested) == known] for known in (True, False)}


@pytest.mark.parametrize("command", runnable()[True])
def test_documented_command_is_accepted(command, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert read_calls(*shlex.split(command)[2:])


@pytest.mark.slow
@pytest.mark.parametrize("command", runnable()[False])
def test_documented_command(command, outputs, tmp_path, python):
    if "outputs=" in command:
        outputs = tmp_path / "first"  # another configuration than the other commands
    run_command(command, outputs, python)
