import ast
from pathlib import Path

from conftest import ROOT

ORDER = [
    *("config", "runs", "grid", "behaviors", "worlds", "recording", "store", "projection", "datasets"),
    *("models", "losses", "metrics", "planning", "callbacks", "training", "evaluation"),
    *("paper", "results", "report", "figures", "publish"),
]
STANDALONE = ("models", "losses", "metrics")


def imported(path: Path) -> set[str]:
    """Names of the modules of ours that a module imports."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "repro":
            names |= {node.module.split(".")[1]} if "." in node.module else {a.name for a in node.names}
    return names


def test_imports_go_down_the_data_path():
    modules = {path.stem: path for path in (ROOT / "src" / "repro").glob("[!_]*.py")}
    assert sorted(modules) == sorted(ORDER)
    for name, path in modules.items():
        upward = [other for other in imported(path) if ORDER.index(other) >= ORDER.index(name)]
        assert not upward, f"{name} imports {upward}"
        if name in STANDALONE:
            assert not imported(path), name


def test_only_run_py_imports_hydra():
    for path in (ROOT / "src").rglob("*.py"):
        assert "import hydra" not in path.read_text(), path
        assert "from hydra" not in path.read_text(), path
