"""The entry point: Hydra composes the configuration, `repro.cli` checks it and runs a task.

python run.py exp=3 model=unet                                         record what is missing, train, evaluate
python run.py -m model=unet,fpn,upernet,segformer exp=3,4 decay=false  a sweep, then its table
python run.py task=record exp=3                                        simulate and store one experiment
python run.py task=report                                              tables and figures from the runs that are there
python run.py task=world exp=3 seed=17                                 write one world and its twin as IR-SIM YAML
"""

import argparse
import os
import signal
import sys
import traceback
import uuid
from pathlib import Path
from typing import Any

import hydra
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra._internal.utils import get_args_parser
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, QuotedString
from hydra.errors import HydraException, OverrideParseException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from repro.cli.config import STUDY_TASKS, Config, schema, to_typed
from repro.cli.errors import explain
from repro.cli.jobs import resolve
from repro.cli.tasks import run_task
from repro.cli.validation import all_errors, has_gpu, one_of, renamed_errors, unknown_key, warnings_of
from repro.config import NO_DECAY, plain
from repro.runs.directories import Outputs
from repro.runs.keys import RunKey
from repro.system.resources import parallel_trainings, use_one_thread

CONF = Path(__file__).resolve().parent / "conf"
GROUPS = ("world", "encoding", "model", "scale", "train")
WANTS_TRACEBACKS = bool(os.environ.get("HYDRA_FULL_ERROR"))
MANY_JOBS = 40  # composing them takes ten seconds
FAILURES = "REPRO_FAILURES"  # names the file in which the jobs of a call, in whatever process, note their failures


class Refused(Exception):
    """A call that cannot be run; its arguments are the reasons, one line each."""


def job_directory(task: str, exp: str, model: str, encoding: str, decay: bool, seed: int) -> str:
    """Return where Hydra writes its files of a job, below the outputs directory: the job's own directory."""
    if task in ("all", "train", "evaluate"):
        return str(RunKey(exp, model, encoding if decay else f"{encoding}{NO_DECAY}", seed).path)
    return f"recordings/exp{exp}" if task == "record" else "hydra"


OmegaConf.register_new_resolver("job_directory", job_directory, replace=True)
OmegaConf.register_new_resolver("default_scale", lambda: "paper" if has_gpu() else "laptop", replace=True)
OmegaConf.register_new_resolver("default_launcher", lambda: "basic" if has_gpu() else "cores", replace=True)
OmegaConf.register_new_resolver("home", os.path.expanduser, replace=True)  # Hydra does not expand ~
OmegaConf.register_new_resolver("parallel_trainings", parallel_trainings, replace=True)
OmegaConf.register_new_resolver("first_key", lambda mapping: next(iter(mapping or {}), ""), replace=True)
ConfigStore.instance().store(name="schema", node=schema())


@hydra.main(version_base="1.3", config_path="conf", config_name="config")
def main(config: DictConfig) -> None:
    """Run one job; a failure is printed and noted, so that the other jobs of a sweep go on."""
    call = to_typed(plain(config))
    try:
        run_task(resolve(call))
    except Exception as error:
        report_failure(call, error)


def report_failure(config: Config, error: Exception) -> None:
    message = explain(error)
    if message is None or WANTS_TRACEBACKS:
        traceback.print_exception(error)
    line = (message or f"{type(error).__name__}: {error}").split("\n")[0]
    print(f"error: {message or line}", file=sys.stderr, flush=True)
    job = f"exp={config.exp} model={config.model.name} decay={str(config.decay).lower()} seed={config.seed}"
    with open(os.environ[FAILURES], "a") as file:
        file.write(f"{job}: {line}\n")


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
    except (HydraException, OmegaConfBaseException) as error:
        if WANTS_TRACEBACKS:
            raise
        raise Refused(*composition_errors(error)) from error


def override_errors(override: Override, multirun: bool) -> list[str]:
    """Return what is wrong with an override as far as it shows without composing."""
    key, written = override.key_or_group, override.input_line or ""
    renamed = renamed_errors([(key, written.partition("=")[2])])
    if renamed:
        return renamed
    if not key:
        return [f"{written}: an override is key=value"]
    if override.is_delete() and "." not in key:
        return [f"{written}: {key} cannot be left out"]
    if override.is_sweep_override() and not multirun:
        return [f"{written}: takes one value; for a sweep, add -m"]
    if key not in GROUPS or override.is_sweep_override():
        return []
    if not isinstance(override.value(), str | QuotedString):
        return [f"{written}: takes one name; for a sweep over several, use -m {key}=a,b"]
    if override.is_add():
        return [f"{written}: {key} is set already; write it without +"]
    return []


def composition_errors(error: Exception) -> list[str]:
    """Explain why a call cannot be parsed or composed, each reason in one line where it is known."""
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
        group, _, name = first.split("'")[-2].rpartition("/")
        options = [line for line in rest if line and not line.startswith("Available")]
        return [f"{group}={name}: {one_of(name, options)}"]
    return [first]


def print_notes(configs: list[Config], arguments: argparse.Namespace) -> None:
    """Print the scale where it was not chosen, what it costs, and warnings."""
    scale, chosen = configs[0].scale, any(override.startswith("scale=") for override in arguments.overrides)
    if not chosen and configs[0].task != "docs":
        why = "a CUDA GPU is visible" if has_gpu() else "no CUDA GPU is visible"
        other = "laptop" if scale.name == "paper" else "paper"
        takes = OmegaConf.load(CONF / "scale" / f"{other}.yaml").takes
        print(f"scale={scale.name} ({why}): {scale.size_px} px, the whole study takes {scale.takes}", flush=True)
        print(f"  the other default, scale={other}, takes {takes}; scale=smoke takes minutes", flush=True)
    for warning in dict.fromkeys(warning for each in configs for warning in warnings_of(each)):
        print(f"note: {warning}", file=sys.stderr)
    trainings = [config for config in configs if config.task in ("all", "train") and config.scale.name == "paper"]
    if trainings and not has_gpu():
        from repro.cli.cost import print_cost  # imports torch

        print_cost([resolve(config) for config in trainings])


def run_jobs(configs: list[Config], multirun: bool) -> int:
    """Run the jobs of a call by Hydra, then print the tables of a sweep and the failures; return the exit status."""
    outputs = {Path(config.outputs) for config in configs}
    failures = min(outputs).absolute() / f".failures-{uuid.uuid4().hex}"
    failures.parent.mkdir(parents=True, exist_ok=True)
    os.environ[FAILURES] = str(failures)
    if multirun and not has_gpu():
        use_one_thread()
    try:
        main()
        left_out: list[str] = []
        if multirun and configs[0].task in ("all", "evaluate"):
            from repro.cli.output import print_tables  # imports pandas

            tables = tuple({config.decay: "main" if config.decay else "ablation" for config in configs}.values())
            left_out = [error for path in sorted(outputs) for error in print_tables(Outputs(path), tables)]
        failed = failures.read_text().splitlines() if failures.is_file() else []
    finally:
        failures.unlink(missing_ok=True)
    if failed and multirun:
        print("failed:", *(f"  {line}" for line in failed), sep="\n", file=sys.stderr)
    return int(bool(failed or left_out))


def command_line() -> int:
    """Run the call; return 0, 1 when a job failed, 2 when the call is refused, 130 when it is interrupted."""
    arguments = get_args_parser().parse_args()
    informational: list[Any] = [arguments.help, arguments.hydra_help, arguments.cfg, arguments.info]
    if any(informational) or arguments.shell_completion:
        main()
        return 0
    os.environ["HYDRA_FULL_ERROR"] = "1"  # errors come here, not to Hydra
    try:
        configs = compose_jobs(arguments)
        print_notes(configs, arguments)
        return run_jobs(configs, arguments.multirun)
    except Refused as reasons:
        print("error: this cannot be run", *(f"  {reason}" for reason in reasons.args), sep="\n", file=sys.stderr)
        return 2
    except OSError as error:
        if WANTS_TRACEBACKS or explain(error) is None:
            raise
        print(f"error: {explain(error)}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # like Ctrl-C: the workers of a sweep end with it
    try:
        sys.exit(command_line())
    except KeyboardInterrupt:
        print("\ninterrupted: the same command resumes", file=sys.stderr)
        sys.exit(130)
