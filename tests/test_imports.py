"""The module graph, from the source: import order, cycles, and modules that see the configuration or the simulator."""

import ast
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from graphlib import TopologicalSorter

import pytest
from conftest import ROOT

import repro

SOURCE = ROOT / "src" / "repro"
LIBRARY = ("system", "scans", "maps", "metrics", "networks", "logs", "prediction", "ros")  # the rest is the study
ROS2 = "ros.ros2_node"  # needs the modules of ROS 2
OF_THE_STUDY = (
    *("torch", "safetensors", "irsim", "hydra", "omegaconf", "lightning", "segmentation_models_pytorch", "timm"),
    *("pandas", "sklearn", "shapely", "joblib", "jinja2", "uncertainties", "onnx", "huggingface_hub"),
)
WITHOUT_SIMULATOR = ("repro.learning.training", "repro.evaluation.scoring", "repro.recordings.reader")


def trees() -> dict[str, ast.Module]:
    """Return the syntax tree of every module by its name without `repro.`; a package has the name of its directory."""
    found = {}
    for path in sorted(SOURCE.rglob("*.py")):
        parts = path.relative_to(SOURCE).with_suffix("").parts
        found[".".join(part for part in parts if part != "__init__")] = ast.parse(path.read_text(), str(path))
    return found


TREES = trees()


def imports_of(root: ast.AST) -> Iterator[str]:
    """Yield the full names that are imported at the top or inside a function, without `if TYPE_CHECKING`."""
    for node in ast.iter_child_nodes(root):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"relative import: {ast.unparse(node)}"
            yield from (str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names))
        elif not (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)):
            yield from imports_of(node)


def imported(tree: ast.Module) -> set[str]:
    """Return the names of our modules, and packages with content, that a module imports."""
    ours = {name.removeprefix("repro.") for name in imports_of(tree) if name.startswith("repro.")} & set(TREES)
    return {name for name in ours if not is_package(name) or len(TREES[name].body) > 1}


def is_package(name: str) -> bool:
    return (SOURCE / name.replace(".", "/")).is_dir()


GRAPH = {name: imported(tree) - {name} for name, tree in TREES.items()}


def package_of(module: str) -> str:
    return module.split(".")[0]


def test_packages_import_downward_only():
    """They have an order in which each imports from those before it alone."""
    packages: dict[str, set[str]] = {}
    for name, others in GRAPH.items():
        own = packages.setdefault(package_of(name), set())
        own |= {package_of(other) for other in others} - {package_of(name)}
    TopologicalSorter(packages).prepare()  # raises CycleError


def test_the_library_does_not_import_the_study():
    assert {package_of(name) for name in TREES} >= set(LIBRARY)
    upward = {
        f"{name} imports {other}"
        for name, others in GRAPH.items()
        if package_of(name) in LIBRARY
        for other in others
        if package_of(other) not in LIBRARY
    }
    assert not upward


def test_the_library_names_no_package_of_the_study():
    """Neither at the top of a module nor inside a function, where it would be imported late."""
    named = {
        f"{name} imports {package}"
        for name, tree in TREES.items()
        if package_of(name) in LIBRARY
        for package in {other.split(".")[0] for other in imports_of(tree)} & set(OF_THE_STUDY)
    }
    assert not named


def test_modules_and_classes_have_names_of_their_own():
    """But for tasks, which are named for what they do."""
    modules = Counter(name.rpartition(".")[2] for name in TREES if not is_package(name) and "cli.tasks" not in name)
    classes = Counter(node.name for tree in TREES.values() for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    assert [name for name, count in (modules + classes).items() if count > 1] == []


def test_the_module_graph_has_no_cycle():
    TopologicalSorter(GRAPH).prepare()  # raises CycleError


def test_only_the_command_line_imports_hydra():
    users = {name for name, tree in TREES.items() if any(path.split(".")[0] == "hydra" for path in imports_of(tree))}
    assert users == {"cli.compose", "cli.main"}


def loaded_by(code: str) -> set[str]:
    """Run code in a new process and return the packages that it has loaded."""
    command = [sys.executable, "-c", f"import sys; {code}; print(*{{name.split('.')[0] for name in sys.modules}})"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    return set(done.stdout.split())


MODULES = [f"repro.{name}" for name in TREES if package_of(name) in LIBRARY and name != ROS2]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "unneeded"),
    [
        (f"import {', '.join(MODULES)}", OF_THE_STUDY),
        (f"from repro import {', '.join(repro.__all__)}", OF_THE_STUDY),
        (f"import {', '.join(WITHOUT_SIMULATOR)}", ("irsim",)),
        ("import repro.runs.parallel", ("torch",)),
    ],
    ids=["library", "public names", "training and evaluation", "processes"],
)
def test_what_is_imported_needs_no_more(code, unneeded):
    assert not loaded_by(code) & set(unneeded)


def test_other_names_than_the_public_ones_are_refused():
    assert set(repro.__all__) <= set(dir(repro))
    with pytest.raises(AttributeError, match="no attribute 'load_predictors'"):
        repro.load_predictors  # noqa: B018


def test_text_files_are_utf8_in_any_locale():
    """Each call that reads or writes text names its encoding, since the default is that of the locale."""
    rule = [sys.executable, "-m", "ruff", "check", "--quiet", "--preview", "--select", "PLW1514", "src", "run.py"]
    subprocess.run(rule, cwd=ROOT, check=True)
