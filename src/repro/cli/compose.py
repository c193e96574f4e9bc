"""Composition of a call by Hydra: every job of it, before one of them runs or a file is written."""

import argparse
import math
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any

import hydra
import yaml
from hydra._internal.callbacks import Callbacks
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, QuotedString
from hydra.core.plugins import Plugins
from hydra.core.utils import run_job
from hydra.errors import HydraException, OverrideParseException
from hydra.types import HydraContext
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from repro.cli.refusals import WANTS_TRACEBACKS, Refused, did_you_mean
from repro.cli.tasks import summaries, tasks
from repro.runs.config import NO_DECAY, EncodingChoice
from repro.runs.keys import RunKey
from repro.runs.parallel import has_gpu, parallel_trainings
from repro.system.errors import InputError
from repro.system.fields import UNKNOWN_KEY
from repro.system.files import check_size
from repro.system.progress import progress
from repro.system.project import conf_directory
from repro.worlds.spec import plain

GROUPS = ("world", "encoding", "model", "scale", "train")


def job_directory(task: str, exp: str, model: str, encoding: str, decay: bool, seed: int) -> str:
    """Return where Hydra writes its files of a job, below the outputs directory: the job's own directory."""
    place = tasks()[task].place if task in tasks() else "outputs"
    if place == "run":
        return str(RunKey(exp, model, encoding if decay else f"{encoding}{NO_DECAY}", seed).path)
    return f"recordings/exp{exp}" if place == "recordings" else "hydra"


RESOLVERS: dict[str, Any] = {  # that conf/ uses
    "job_directory": job_directory,
    "default_scale": lambda: "paper" if has_gpu() else "laptop",
    "default_launcher": lambda: "cores" if find_spec("joblib") and not has_gpu() else "basic",
    "home": os.path.expanduser,  # Hydra does not expand ~
    "parallel_trainings": lambda size_px, batch_size, pairs, parameters: parallel_trainings(
        size_px, batch_size, pairs.train + pairs.val, EncodingChoice("", parameters).most_channels
    ),
    "first_key": lambda mapping: next(iter(mapping or {}), ""),
    "tasks": lambda: "\n".join(f"  {name:<15} {summary}" for name, summary in summaries().items()),
}
for _name, _resolver in RESOLVERS.items():
    OmegaConf.register_new_resolver(_name, _resolver, replace=True)


MAX_VALUES = 20_000  # of a file of a group; Hydra takes a second for as many
MAX_JOBS = 2000  # of a sweep, which are composed before the first one runs


@dataclass(frozen=True)
class Composed:
    """A composed job.

    Args:
        overrides: the overrides of the command line for this job.
        config: its configuration, with that of Hydra.
        values: the configuration without that of Hydra as plain values.
    """

    overrides: list[str]
    config: DictConfig
    values: dict[str, Any]

    @classmethod
    def of(cls, overrides: list[str]) -> "Composed":
        """Compose a job."""
        config = hydra.compose("config", overrides, return_hydra_config=True)
        keys = [str(key) for key in config if key != "hydra"]
        return cls(overrides, config, plain(OmegaConf.masked_copy(config, keys)))

    def run(self, function: Any) -> Any:
        """Run a function of the configuration as a job of Hydra, and return what it returns."""
        keys = {"job_dir_key": "hydra.run.dir", "job_subdir_key": None}
        return run_job(function, self.config, **keys, hydra_context=_context(self.config)).return_value  # type: ignore


def launch(jobs: list[Composed], function: Any) -> list[Any]:
    """Run a function of the configuration for every job by Hydra's launcher, and return what they return."""
    config = jobs[0].config
    launcher = Plugins.instance().instantiate_launcher(_context(config), function, config)
    overrides = [[override for override in job.overrides if not _is_of_hydra(override)] for job in jobs]
    return [result.return_value for result in launcher.launch(overrides, initial_job_idx=0)]


def _context(config: DictConfig) -> HydraContext:
    return HydraContext(GlobalHydra.instance().config_loader(), Callbacks(config))


def _is_of_hydra(override: str) -> bool:
    return override.lstrip("+~").startswith(("hydra.", "hydra/"))


@contextmanager
def composed(arguments: argparse.Namespace) -> Iterator[list[Composed]]:
    """Compose every job of a call, in a context in which Hydra can run them.

    Raises:
        Refused: a job cannot be composed.
    """
    overrides = list(arguments.overrides)
    if arguments.config_dir:
        if not os.path.isdir(arguments.config_dir):
            raise Refused(f"--config-dir={arguments.config_dir}: is not a directory")
        overrides.append(f"hydra.searchpath=[file://{Path(arguments.config_dir).absolute()}]")
    places = [conf_directory(), Path(arguments.config_dir or conf_directory())]
    if errors := list(dict.fromkeys(_file_errors(overrides, places))):
        raise Refused(*errors)
    with hydra.initialize_config_dir(str(conf_directory()), version_base="1.3"):
        try:
            jobs = _jobs(overrides, arguments.multirun)
            found = [Composed.of(job) for job in progress(jobs, "checking jobs")]
            _check_hydra(found)
        except (HydraException, OmegaConfBaseException, YAMLError, RecursionError, TypeError, ValueError) as error:
            if isinstance(error, Refused) or WANTS_TRACEBACKS:
                raise
            raise Refused(_reason(error)) from error
        yield found


def _jobs(overrides: list[str], multirun: bool) -> list[list[str]]:
    """Return the overrides of every job.

    Raises:
        Refused: an override is wrong, or there are no jobs.
    """
    parsed = OverridesParser.create(GlobalHydra.instance().config_loader()).parse_overrides(overrides)
    if errors := [error for override in parsed for error in _override_errors(override, multirun)]:
        raise Refused(*errors)
    if not multirun:
        return [overrides]
    values = {  # by key, of which the last one counts
        override.get_key_element(): list(override.sweep_string_iterator())
        if override.is_sweep_override()
        else [override.get_value_element_as_str()]
        for override in parsed
    }
    jobs = math.prod(map(len, values.values()))
    if not 1 <= jobs <= MAX_JOBS:
        raise Refused(f"the sweep has {jobs or 'no'} jobs: expected 1 to {MAX_JOBS}")
    return [[f"{key}={value}" for key, value in zip(values, job, strict=True)] for job in product(*values.values())]


def _file_errors(overrides: list[str], places: list[Path]) -> Iterator[str]:
    """Yield which chosen files would take long to compose, since their aliases stand for many values."""
    for group, _, names in (override.partition("=") for override in overrides):
        files = (place / group / f"{name}.yaml" for name in re.split(r"[,'\"]+", names) for place in places)
        for path in filter(Path.is_file, files if group in GROUPS else ()):
            try:
                text = path.read_text(encoding="utf-8")
                if "*" in text:
                    check_size(yaml.safe_load(text), MAX_VALUES)
            except InputError as error:
                yield f"{path}: {error}"
            except (OSError, ValueError, YAMLError, RecursionError):  # which Hydra names
                continue


def _override_errors(override: Override, multirun: bool) -> Iterator[str]:
    """Yield what is wrong with an override that Hydra would accept, or refuse without naming it or after other jobs."""
    key, written = override.key_or_group, override.input_line
    if not key:
        yield f"{written}: {_NO_OVERRIDE}"
    elif override.is_sweep_override() and not multirun:
        yield f"{written}: several values: -m runs a job for each, [a,b] is a list, and quotes keep a comma"
    elif key in GROUPS and not (override.is_sweep_override() or isinstance(override._value, str | QuotedString)):
        yield f"{written}: takes one name; for a sweep over several, use -m {key}=a,b; a number is quoted"
    elif key == "hydra/launcher" and "slurm" in str(written) and not shutil.which("srun"):
        yield f"{written}: no Slurm on this machine: srun is not found"


def _check_hydra(jobs: list[Composed]) -> None:
    """Check that no file of a group changes the configuration of Hydra.

    Hydra calls what its configuration names, and a file of conf/world, for example, may come from somebody else.

    Raises:
        Refused: one does.
    """
    own = [override for override in jobs[0].overrides if _is_of_hydra(override)]
    expected = _hydra_part(hydra.compose("config", own, return_hydra_config=True))
    for job in jobs:
        found = _hydra_part(job.config)
        for key in found | expected:
            if found.get(key) != expected.get(key):
                chosen = ", ".join(override for override in job.overrides if override.partition("=")[0] in GROUPS)
                raise Refused(f"{chosen}: a file sets hydra.{key}; only the command line configures Hydra")


def _hydra_part(config: DictConfig) -> dict[str, Any]:
    """Return the configuration of Hydra itself without what names the job, interpolations not resolved."""
    part: Any = OmegaConf.to_container(config.hydra, resolve=False)
    part["job"] = {key: value for key, value in part["job"].items() if key.startswith("env_")}
    return {key: value for key, value in part.items() if key not in ("overrides", "runtime")}


def _reason(error: Exception) -> str:
    """Return in one line why a call cannot be composed: Hydra's words, and what may have been meant."""
    if isinstance(error, OverrideParseException):
        key, equals, value = error.override.partition("=")
        if not equals:
            return f"{error.override}: {_NO_OVERRIDE}"
        if not error.override.isprintable():  # as the bytes of a name in another encoding
            name = error.override.encode("utf-8", "surrogateescape")
            return f"{ascii(name)[2:-1]}: is no printable text in UTF-8: rename the file, or make a link to it"
        return f"{error.override}: cannot be read; quote the value for Hydra and for the shell: '{key}=\"{value}\"'"
    text = re.split("\n(?:Config search path|See https)", str(error))[0]
    words = " ".join(line.strip() for line in text.splitlines() if not line.strip().startswith(_DETAILS))
    if isinstance(error, YAMLError | RecursionError | UnicodeDecodeError) or not words:
        return f"a configuration file cannot be read: {words or 'it has a key that is no text'}"
    if absent := re.fullmatch(r"In '.*config': Could not find '(.+)/(.+)' +Available options in '.+': (.+)", words):
        return f"{absent[1]}={absent[2]}: must be one of {', '.join(absent[3].split())}"
    where = re.search(r"^\s*full_key: (.+)$", str(error), re.MULTILINE)
    words = f"{where[1]}: {words}" if where and "nterpolation" in words else words
    cause = f": {str(error.__cause__).splitlines()[0]}" if error.__cause__ else ""
    if unknown := re.match(r"Could not override '(?!hydra)([^']*)'", text):
        key, is_open = unknown[1], ".parameters." in unknown[1] or unknown[1].startswith("world.")
        adding = f"; +{key}=... adds it" if is_open else ""
        return f"{key}: {UNKNOWN_KEY}{did_you_mean(key, plain(hydra.compose('config')))}{adding}"
    return f"{words}{cause}"


_NO_OVERRIDE = "an override is key=value"
_DETAILS = ("full_key", "object_type", "reference_type")  # lines that say nothing to a user
