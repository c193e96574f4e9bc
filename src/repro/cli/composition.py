"""Composition of the configurations of a call by Hydra, checked before Hydra runs a job or writes a file."""

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import hydra
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException, OverrideParseException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from repro.cli.config import STUDY_TASKS, Config, schema, to_typed
from repro.cli.errors import WANTS_TRACEBACKS
from repro.cli.jobs import ROOT
from repro.cli.logs import name_of
from repro.cli.overrides import GROUPS, override_errors, unused_errors
from repro.cli.suggestions import one_of, unknown_key
from repro.cli.validation import all_errors
from repro.config import NO_DECAY, most_channels
from repro.parallel import has_gpu, parallel_trainings
from repro.runs.keys import RunKey
from repro.world_config import plain

CONF = ROOT / "conf"
MANY_JOBS = 40  # composing them takes ten seconds


class Refused(Exception):
    """A call that cannot be run; its arguments are the reasons, one line each."""


def job_directory(task: str, exp: str, model: str, encoding: str, decay: bool, seed: int) -> str:
    """Return where Hydra writes its files of a job, below the outputs directory: the job's own directory."""
    if task in ("all", "train", "evaluate"):
        return str(RunKey(exp, model, encoding if decay else f"{encoding}{NO_DECAY}", seed).path)
    return f"recordings/exp{exp}" if task == "record" else "hydra"


def register() -> None:
    """Register the schema of the configuration and the resolvers that conf/ uses."""
    OmegaConf.register_new_resolver("job_directory", job_directory, replace=True)
    OmegaConf.register_new_resolver("default_scale", lambda: "paper" if has_gpu() else "laptop", replace=True)
    OmegaConf.register_new_resolver("default_launcher", lambda: "basic" if has_gpu() else "cores", replace=True)
    OmegaConf.register_new_resolver("home", os.path.expanduser, replace=True)  # Hydra does not expand ~
    OmegaConf.register_new_resolver("parallel_trainings", _parallel_trainings, replace=True)
    OmegaConf.register_new_resolver("most_channels", most_channels, replace=True)
    OmegaConf.register_new_resolver("first_key", lambda mapping: next(iter(mapping or {}), ""), replace=True)
    ConfigStore.instance().store(name="schema", node=schema())


def _parallel_trainings(size_px: int, batch_size: int, pairs: DictConfig, channels: int, loss: str) -> int:
    return parallel_trainings(size_px, batch_size, pairs.train + pairs.val, channels, loss)


def compose_jobs(arguments: argparse.Namespace) -> list[Config]:
    """Compose and check every job of a call before Hydra writes anything.

    Raises:
        Refused: a job cannot be run.
    """
    values = compose_values(arguments)
    errors = dict.fromkeys(str(error) for each in values for error in all_errors(each))
    if errors:
        raise Refused(*errors)
    configs = [to_typed(each) for each in values]
    tasks = dict.fromkeys(config.task for config in configs)
    if len(tasks) > 1:
        raise Refused(f"task={','.join(tasks)}: a sweep has one task; its jobs may run at the same time")
    if len({config.outputs for config in configs}) < len(configs) and configs[0].task in STUDY_TASKS:
        raise Refused(f"task={configs[0].task}: is done once for all runs; leave out the sweep")
    unused = unused_errors(arguments.overrides, configs[0].task)
    if unused:
        raise Refused(*unused)
    targets = [(config.outputs, name_of(Path(config.scans))) for config in configs if config.scans]
    if len(set(targets)) < len(targets):
        name = next(name for outputs, name in targets if targets.count((outputs, name)) > 1)
        raise Refused(f"several predictions would write to predictions/{name}: make a call with outputs= for each")
    return configs


def compose_values(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Compose the values of every job of a call.

    Raises:
        Refused: a job cannot be composed.
    """
    if arguments.config_name or arguments.config_path:
        raise Refused("--config-name and --config-path are not supported: use overrides, or --config-dir for groups")
    if arguments.experimental_rerun:  # what argparse makes of --exp
        raise Refused(
            f"--exp={arguments.experimental_rerun}: overrides have no dashes: exp={arguments.experimental_rerun}"
        )
    overrides = list(arguments.overrides)
    if arguments.config_dir and not Path(arguments.config_dir).is_dir():
        raise Refused(f"--config-dir={arguments.config_dir}: is not a directory")
    if arguments.config_dir:
        overrides.append(f"hydra.searchpath=[file://{Path(arguments.config_dir).absolute()}]")
    with _refusing(arguments.config_dir, overrides), hydra.initialize_config_dir(str(CONF), version_base="1.3"):
        parser = OverridesParser.create(config_loader=GlobalHydra.instance().config_loader())
        parsed = parser.parse_overrides(overrides)
        wrong = [error for each in parsed for error in override_errors(each, arguments.multirun)]
        if wrong:
            raise Refused(*wrong)
        batches = BasicSweeper.split_arguments(parsed, None) if arguments.multirun else [[overrides]]
        jobs = [job for batch in batches for job in batch]
        if not jobs:
            raise Refused("the sweep has no jobs: a pattern matches nothing")
        if len(jobs) > MANY_JOBS:
            print(f"checking {len(jobs)} jobs", file=sys.stderr, flush=True)
        return list(_composed(jobs))


@contextmanager
def _refusing(config_dir: str | None, overrides: Sequence[str]) -> Iterator[None]:
    """Refuse a call whose configuration cannot be composed, with the reasons.

    Args:
        config_dir: a directory beside conf/ that has files of groups.
        overrides: the overrides of the call.

    Raises:
        Refused: a job cannot be composed.
    """
    try:
        yield
    except (HydraException, OmegaConfBaseException, YAMLError, RecursionError, TypeError, ValueError) as error:
        if WANTS_TRACEBACKS:
            raise
        reasons = composition_errors(error, overrides)
        if isinstance(error, UnicodeDecodeError):  # which does not name its file
            folders = [CONF, *([Path(config_dir)] if config_dir else [])]
            reasons = [f"{path}: is not UTF-8" for folder in folders for path in _not_utf8(folder)] or reasons
        raise Refused(*reasons) from error


def _composed(jobs: list[list[str]]) -> Iterator[dict[str, Any]]:
    """Yield the values of every job.

    Only conf/config.yaml and the command line may configure Hydra, which calls what its configuration names; a file of
    conf/world, for example, may come from somebody else.

    Raises:
        Refused: a file of a group changes the configuration of Hydra.
    """
    expected: dict[tuple[str, ...], dict[str, Any]] = {}
    for job in jobs:
        composed = hydra.compose("config", overrides=job, return_hydra_config=True)
        own = tuple(each for each in job if each.lstrip("+~").startswith("hydra"))
        if own not in expected:
            expected[own] = _hydra_part(hydra.compose("config", overrides=list(own), return_hydra_config=True))
        found = _hydra_part(composed)
        changed = [key for key in found | expected[own] if found.get(key) != expected[own].get(key)]
        if changed:
            chosen = ", ".join(each for each in job if each.partition("=")[0] in GROUPS)
            raise Refused(f"{chosen}: a file sets hydra.{changed[0]}; only the command line configures Hydra")
        yield plain(OmegaConf.masked_copy(composed, [str(key) for key in composed if key != "hydra"]))


def _hydra_part(composed: DictConfig) -> dict[str, Any]:
    """Return the configuration of Hydra itself without what names the job, interpolations not resolved."""
    part: Any = OmegaConf.to_container(composed.hydra, resolve=False)
    part["job"] = {key: value for key, value in part["job"].items() if key.startswith("env_")}
    return {key: value for key, value in part.items() if key not in ("overrides", "runtime")}


def _not_utf8(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.rglob("*.yaml")):
        try:
            path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            yield path


def _choices(overrides: Sequence[str]) -> list[str]:
    """Return the overrides that choose one file of a group in conf/ and exist there."""
    chosen = [each.partition("=") for each in overrides]
    return [
        f"{group}={name}" for group, _, name in chosen if group in GROUPS and (CONF / group / f"{name}.yaml").is_file()
    ]


def _value_error(message: str) -> str:
    if message.startswith(("Index '", "invalid literal for int")):  # OmegaConf's own for an entry of a list
        name = message.split("'")[1]
        message = f"{name}: an entry of a list is named by its number, as in world.robot.sensors.0"
    return " ".join(message.split())


def composition_errors(error: Exception, overrides: Sequence[str] = ()) -> list[str]:
    """Explain why a call cannot be parsed or composed, each reason in one line where it is known.

    Args:
        error: what was raised.
        overrides: the overrides of the call, whose files of conf/ have the known keys.
    """
    if isinstance(error, YAMLError | RecursionError | UnicodeDecodeError):
        return [f"a configuration file cannot be read: {' '.join(str(error).split())}"]
    if not isinstance(error, HydraException | OmegaConfBaseException):
        return [_value_error(str(error))]
    lines = [line.strip() for line in str(error).split("\nConfig search path")[0].splitlines()]
    first, *rest = lines or ["a configuration file has a key that is no text"]  # OmegaConf states nothing
    if isinstance(error, OverrideParseException):
        key, equals, value = error.override.partition("=")
        if not (key and equals):
            return [f"{error.override}: an override is key=value"]
        return [f"{error.override}: cannot be read; quote the value for Hydra and for the shell: '{key}=\"{value}\"'"]
    if first.startswith("Could not override 'hydra."):
        return [f"{first.split(chr(39))[1]}: is not a known key of Hydra"]
    if first.startswith("Could not override"):
        with hydra.initialize_config_dir(str(CONF), version_base="1.3"):
            values = plain(hydra.compose("config", overrides=_choices(overrides)))
        return [str(unknown_key(first.split("'")[1], None, values))]
    if first.startswith("Error merging override "):
        return [f"{first.removeprefix('Error merging override ')}: {str(error.__cause__).splitlines()[0]}"]
    if "Could not find '" in first:
        path = first.split("'")[-2]
        group = path.split("/")[0] if path.startswith(GROUPS) else path.rpartition("/")[0]
        name = path.removeprefix(f"{group}/")
        options = [line for line in rest if line and not line.startswith("Available")]
        return [f"{group}={name}: {one_of(name, options)} (files of conf/{group})"]
    return [
        " ".join([first, *(line for line in rest if not line.startswith(("full_key", "object_type", "reference")))])
    ]
