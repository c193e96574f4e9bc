"""Composition of the configurations of a call by Hydra, checked before Hydra runs a job or writes a file."""

import argparse
import os
import shutil
import sys
from pathlib import Path
from typing import Any

import hydra
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, QuotedString
from hydra.errors import HydraException, OverrideParseException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from repro.cli.config import STUDY_TASKS, Config, schema, to_typed
from repro.cli.errors import WANTS_TRACEBACKS
from repro.cli.jobs import ROOT
from repro.cli.limits import most_channels
from repro.cli.validation import all_errors, has_gpu, one_of, unknown_key
from repro.config import NO_DECAY, plain
from repro.runs.keys import RunKey
from repro.system.resources import parallel_trainings

CONF = ROOT / "conf"
GROUPS = ("world", "encoding", "model", "scale", "train")
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
    OmegaConf.register_new_resolver("parallel_trainings", parallel_trainings, replace=True)
    OmegaConf.register_new_resolver("most_channels", most_channels, replace=True)
    OmegaConf.register_new_resolver("first_key", lambda mapping: next(iter(mapping or {}), ""), replace=True)
    ConfigStore.instance().store(name="schema", node=schema())


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
    try:
        with hydra.initialize_config_dir(str(CONF), version_base="1.3"):
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
            return [plain(hydra.compose("config", overrides=job)) for job in jobs]
    except (HydraException, OmegaConfBaseException, YAMLError, UnicodeDecodeError, RecursionError) as error:
        if WANTS_TRACEBACKS:
            raise
        raise Refused(*composition_errors(error)) from error
    except (TypeError, ValueError) as error:  # OmegaConf's own for the name of an entry of a list
        name = str(error).rpartition(": ")[2]
        raise Refused(f"{name}: an entry of a list is named by its number, as in world.robot.sensors.0") from error


def override_errors(override: Override, multirun: bool) -> list[str]:
    """Return what is wrong with an override as far as it shows without composing."""
    key, written = override.key_or_group, override.input_line or ""
    if not key:
        return [f"{written}: an override is key=value"]
    if override.is_delete() and "." not in key:
        return [f"{written}: {key} cannot be left out"]
    if override.is_sweep_override() and not multirun:
        return [f"{written}: takes one value; for a sweep, add -m"]
    if key == "hydra/launcher" and "slurm" in written and not shutil.which("srun"):
        return [f"{written}: no Slurm on this machine: srun is not found"]
    if key not in GROUPS or override.is_sweep_override():
        return []
    if not isinstance(override.value(), str | QuotedString):
        return [f"{written}: takes one name; for a sweep over several, use -m {key}=a,b"]
    if override.is_add():
        return [f"{written}: {key} is set already; write it without +"]
    return []


def composition_errors(error: Exception) -> list[str]:
    """Explain why a call cannot be parsed or composed, each reason in one line where it is known."""
    if isinstance(error, YAMLError | UnicodeDecodeError | RecursionError):
        return [f"a configuration file cannot be read: {' '.join(str(error).split())}"]
    first, *rest = (line.strip() for line in str(error).split("\nConfig search path")[0].splitlines())
    if isinstance(error, OverrideParseException):
        key, equals, value = error.override.partition("=")
        if not (key and equals):
            return [f"{error.override}: an override is key=value"]
        return [f"{error.override}: cannot be read; quote the value for Hydra and for the shell: '{key}=\"{value}\"'"]
    if first.startswith("Could not override 'hydra."):
        return [f"{first.split(chr(39))[1]}: is not a known key of Hydra"]
    if first.startswith("Could not override"):
        with hydra.initialize_config_dir(str(CONF), version_base="1.3"):
            values = plain(hydra.compose("config"))
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
