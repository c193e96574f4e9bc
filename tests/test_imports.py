import ast

from conftest import ROOT

SOURCE = ROOT / "src" / "repro"
ORDER = [
    *("config", "faults", "files", "names", "scans", "devices", "provenance", "runs", "studies"),
    *(f"simulation.{name}" for name in ("motions", "behaviors", "worlds", "specs", "rays")),
    *("simulation.recording", "simulation.shards", "simulation.store"),
    *(f"maps.{name}" for name in ("grid", "truth", "visible", "projection", "encodings", "datasets")),
    *("learning.convlstm", "learning.models", "prediction"),
    *(f"learning.{name}" for name in ("losses", "kernels", "planning", "callbacks", "checkpoints", "training")),
    *(f"evaluation.{name}" for name in ("metrics", "levels", "calibration", "intervals")),
    *(f"evaluation.{name}" for name in ("grids", "tracking", "baselines", "predictions", "visibility", "examples")),
    *(f"evaluation.{name}" for name in ("recency", "breakdown", "analysis", "transfer", "curves", "samples")),
    *(f"reporting.{name}" for name in ("paper", "audit", "numbers", "claims")),
    *(f"reporting.{name}" for name in ("results", "tables", "status", "figures", "plots", "comparison_figures")),
    *(f"reporting.{name}" for name in ("analysis_figures", "sections", "page", "animation", "digest")),
    *("reporting.publish", "reporting.verification", "reporting.readme"),
    *("checks", "messages", "calls", "outcomes", "tasks"),
]
STANDALONE = ["config", "faults", "files", "messages", "scans", "devices"]
STANDALONE += ["maps.grid", "learning.losses", "learning.kernels", "evaluation.metrics"]


def imported(module: str) -> set[str]:
    """Names of the modules of ours that a module imports, at its top or within a function."""
    names = set()
    for node in ast.walk(ast.parse((SOURCE / f"{module.replace('.', '/')}.py").read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "repro":
            name = node.module.removeprefix("repro").removeprefix(".")
            names |= {name} if name in ORDER else {f"{name}.{a.name}".removeprefix(".") for a in node.names}
        assert not (isinstance(node, ast.ImportFrom) and node.level), f"{module} imports relatively"
    return names


def reached(module: str) -> set[str]:
    """What a module imports, and what that imports."""
    names = imported(module)
    return names.union(*(reached(name) for name in names))


def test_every_module_has_its_place():
    found = [".".join(path.relative_to(SOURCE).with_suffix("").parts) for path in SOURCE.rglob("[!_]*.py")]
    assert sorted(found) == sorted(ORDER)


def test_imports_go_down_the_data_path():
    for index, name in enumerate(ORDER):
        assert imported(name) <= set(ORDER[:index]), f"{name} imports {imported(name) - set(ORDER[:index])}"
        if name in STANDALONE:
            assert not imported(name), name


def test_prediction_on_scans_of_ones_own_needs_no_simulation():
    assert not [name for name in reached("prediction") if name.startswith("simulation")]


def test_encodings_and_metrics_read_no_shards():
    for name in ("maps.encodings", "maps.truth", "evaluation.metrics", "reporting.figures", "reporting.tables"):
        assert not {"simulation.store", "simulation.shards"} & imported(name), name


def test_only_run_py_imports_hydra():
    for path in SOURCE.rglob("*.py"):
        assert "import hydra" not in path.read_text(), path
        assert "from hydra" not in path.read_text(), path
