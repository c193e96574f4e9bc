"""The module graph, from the source: import order, cycles, and modules that see the configuration or the simulator."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter

import pytest
from conftest import ROOT

import repro

SOURCE = ROOT / "src" / "repro"
LIBRARY = (
    "system",
    "fields",
    "scans",
    "outlines",
    "maps",
    "metrics",
    "networks",
    "prediction",
)  # the rest is the study
SMP = "networks.smp_networks"  # the only module of the library that imports smp, when a network of smp is created
ROS2 = "prediction.ros2_node"  # needs the modules of ROS 2
OF_THE_STUDY = (
    *("irsim", "hydra", "omegaconf", "lightning", "segmentation_models_pytorch", "timm"),
    *("pandas", "sklearn", "shapely", "joblib", "jinja2", "uncertainties"),
)
INNER_IMPORTS = 14  # imports inside functions that are worth their cost
CONFIG_FUNCTIONS = 5  # functions that take the whole configuration
WITHOUT_SIMULATOR = (
    "repro.learning.training",
    "repro.evaluation.evaluate",
    "repro.recordings.reader",
)


def trees() -> dict[str, ast.Module]:
    """Return the syntax tree of every module by its name without `repro.`; a package has the name of its directory."""
    found = {}
    for path in sorted(SOURCE.rglob("*.py")):
        parts = path.relative_to(SOURCE).with_suffix("").parts
        found[".".join(part for part in parts if part != "__init__")] = ast.parse(path.read_text(), str(path))
    return found


TREES = trees()


def nodes(root: ast.AST, *, typing: bool = True, depth: int = 0) -> Iterator[tuple[ast.AST, int]]:
    """Yield all nodes below a node and in how many functions each is, without `if TYPE_CHECKING` unless `typing`."""
    for node in ast.iter_child_nodes(root):
        if not typing and isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        yield node, depth
        is_function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        yield from nodes(node, typing=typing, depth=depth + is_function)


def imported(tree: ast.Module) -> set[str]:
    """Return the names of our modules that a module imports, at its top or inside a function."""
    names = set()
    for node, _ in nodes(tree, typing=False):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"relative import: {ast.unparse(node)}"
            names |= {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
    ours = {name.removeprefix("repro.") for name in names if name.startswith("repro.")}
    return {name for name in ours if name in TREES and not is_package(name)} | {
        name for name in ours if name in TREES and is_package(name) and len(TREES[name].body) > 1
    }


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


def test_the_module_graph_has_no_cycle():
    TopologicalSorter(GRAPH).prepare()  # raises CycleError


def test_only_the_command_line_imports_hydra():
    for name, tree in TREES.items():
        if name in ("cli.compose", "cli.main"):
            continue
        for node, _ in nodes(tree):
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            modules += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
            assert not any(module.split(".")[0] == "hydra" for module in modules), f"{name}: {ast.unparse(node)}"


def test_few_imports_are_inside_functions():
    """Those of the tasks keep a refusal from waiting for torch."""
    inner = [
        f"{name}: {ast.unparse(node)}"
        for name, tree in TREES.items()
        if not name.startswith("cli.tasks.")
        for node, depth in nodes(tree, typing=False)
        if depth and isinstance(node, ast.Import | ast.ImportFrom)
    ]
    assert len(inner) <= INNER_IMPORTS, "\n".join(inner)


def test_only_the_command_line_takes_the_whole_configuration():
    """Tasks take a resolved `Job`, everything else takes values."""
    takers = []
    for name, tree in (TREES | {"run.py": ast.parse((ROOT / "run.py").read_text())}).items():
        for node, _ in nodes(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                if any(argument.annotation and ast.unparse(argument.annotation) == "Call" for argument in arguments):
                    takers.append((name, node.name))
    assert len(takers) <= CONFIG_FUNCTIONS, takers
    assert all(name == "run.py" or package_of(name) == "cli" for name, _ in takers), takers


def loaded_by(*modules: str) -> set[str]:
    """Import modules in a new process and return the packages that it has loaded."""
    code = f"import sys, {', '.join(modules)}; print(*{{name.split('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=300)
    return set(done.stdout.split())


@pytest.mark.slow
def test_the_library_needs_no_dependency_of_the_study():
    modules = [name for name in TREES if package_of(name) in LIBRARY and name not in (SMP, ROS2)]
    needed = loaded_by(*(f"repro.{name}" for name in modules)) & set(OF_THE_STUDY)
    assert not needed


@pytest.mark.slow
def test_the_public_names_need_no_dependency_of_the_study():
    code = f"import sys; from repro import {', '.join(repro.__all__)}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=300)
    assert not {name.split(".")[0] for name in done.stdout.split()} & set(OF_THE_STUDY)


def test_public_names_are_imported_at_their_first_use():
    assert "torch" not in loaded_by("repro")
    assert set(repro.__all__) <= set(dir(repro))
    with pytest.raises(AttributeError, match="no attribute 'load_predictors'"):
        repro.load_predictors  # noqa: B018


@pytest.mark.slow
def test_training_evaluation_and_reading_import_no_simulator():
    assert "irsim" not in loaded_by(*WITHOUT_SIMULATOR)


def test_text_files_are_utf8_in_any_locale():
    """Each call that reads or writes text names its encoding, since the default is that of the locale."""
    without = []
    for name, tree in (TREES | {"run.py": ast.parse((ROOT / "run.py").read_text())}).items():
        for node, _ in nodes(tree):
            if not isinstance(node, ast.Call):
                continue
            function = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            is_text = function in ("read_text", "write_text") and isinstance(node.func, ast.Attribute)
            is_text |= function == "open" and any(
                isinstance(a, ast.Constant) and a.value in ("r", "w", "a", "rt") for a in node.args
            )
            if is_text and not any(keyword.arg == "encoding" for keyword in node.keywords):
                without.append(f"{name}:{node.lineno}: {ast.unparse(node)[:80]}")
    assert not without
