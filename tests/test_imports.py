import ast

from conftest import ROOT

SOURCE = ROOT / "src" / "repro"
BASE = ("config", "runs")
ROOMS = {
    "simulation": ("behaviors", "worlds", "recording", "store"),
    "maps": ("grid", "projection", "datasets"),
    "learning": ("models", "losses", "planning", "callbacks", "training"),
    "evaluation": ("metrics", "predictions"),
    "reporting": ("paper", "results", "tables", "figures", "publish"),
}
ORDER = [*BASE, *(f"{room}.{module}" for room, modules in ROOMS.items() for module in modules)]
STANDALONE = ("maps.grid", "learning.losses", "evaluation.metrics")


def imported(module: str) -> set[str]:
    """Names of the modules of ours that a module imports, at its top or within a function."""
    names = set()
    for node in ast.walk(ast.parse((SOURCE / f"{module.replace('.', '/')}.py").read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "repro":
            name = node.module.removeprefix("repro").removeprefix(".")
            names |= {name} if name in ORDER else {f"{name}.{a.name}".removeprefix(".") for a in node.names}
        assert not (isinstance(node, ast.ImportFrom) and node.level), f"{module} imports relatively"
    return names


def test_every_module_has_its_place():
    found = [".".join(path.relative_to(SOURCE).with_suffix("").parts) for path in SOURCE.rglob("[!_]*.py")]
    assert sorted(found) == sorted(ORDER)


def test_imports_go_down_the_data_path():
    for index, name in enumerate(ORDER):
        assert imported(name) <= set(ORDER[:index]), f"{name} imports {imported(name) - set(ORDER[:index])}"
        if name in STANDALONE:
            assert not imported(name), name


def test_only_run_py_imports_hydra():
    for path in SOURCE.rglob("*.py"):
        assert "import hydra" not in path.read_text(), path
        assert "from hydra" not in path.read_text(), path
