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
import warnings
from pathlib import Path
from typing import Any

import hydra
from hydra._internal.utils import get_args_parser
from omegaconf import DictConfig, OmegaConf

from repro.cli.composition import CONF, Refused, compose_jobs, compose_values, register
from repro.cli.config import Config, to_typed
from repro.cli.errors import WANTS_TRACEBACKS, explain
from repro.cli.jobs import resolve
from repro.cli.streams import complete_standard_streams, discard_output
from repro.cli.tasks import run_task
from repro.cli.validation import warnings_of
from repro.parallel import has_gpu, use_one_thread
from repro.runs.outputs import Outputs
from repro.world_config import plain

register()
FAILURES = "REPRO_FAILURES"  # names the file in which the jobs of a call, in whatever process, note their failures


@hydra.main(version_base="1.3", config_path="conf", config_name="config")
def main(config: DictConfig) -> None:
    """Run one job; a failure is printed and noted, so that the other jobs of a sweep go on."""
    call = to_typed(plain(config))
    try:
        run_task(resolve(call))
    except BrokenPipeError:
        raise
    except Exception as error:
        report_failure(call, error)


def report_failure(config: Config, error: Exception) -> None:
    message = explain(error)
    if message is None or WANTS_TRACEBACKS:
        traceback.print_exception(error)
    line = (message or f"{type(error).__name__}: {error}").split("\n")[0]
    print(f"error: {message or line}", file=sys.stderr, flush=True)
    values: dict[str, Any] = {"exp": config.exp, "model": config.model.name, "encoding": config.encoding.name}
    values |= {"decay": str(config.decay).lower(), "seed": config.seed}
    job = " ".join(f"{key}={value}" for key, value in values.items())
    with open(os.environ[FAILURES], "a", encoding="utf-8") as file:
        file.write(f"{job}: {line}\n")


def print_notes(configs: list[Config], arguments: argparse.Namespace) -> None:
    """Print the scale where it was not chosen, what it costs, and warnings."""
    scale, chosen = configs[0].scale, any(override.startswith("scale=") for override in arguments.overrides)
    if not chosen and configs[0].task not in ("docs", "predict", "demo", "floor", "world"):
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
        failed = failures.read_text(encoding="utf-8").splitlines() if failures.is_file() else []
    finally:
        failures.unlink(missing_ok=True)
    if failed and multirun:
        print("failed:", *(f"  {line}" for line in failed), sep="\n", file=sys.stderr)
    return int(bool(failed or left_out))


def command_line() -> int:
    """Run the call; return 0, 1 when a job failed, 2 when the call is refused, 130 when it is interrupted."""
    arguments, unknown = get_args_parser().parse_known_args()
    if unknown:
        print(f"error: {' '.join(unknown)}: not understood; options come first: run.py -m exp=3,4", file=sys.stderr)
        return 2
    if arguments.multirun and arguments.cfg:
        print("error: --cfg prints the configuration of one job: leave out -m", file=sys.stderr)
        return 2
    informational: list[Any] = [arguments.help, arguments.hydra_help, arguments.cfg, arguments.info]
    try:
        if any(informational) or arguments.shell_completion:
            if arguments.cfg or arguments.info:
                compose_values(arguments)  # refuses what cannot be composed
            main()
            return 0
        os.environ["HYDRA_FULL_ERROR"] = "1"  # errors come here, not to Hydra
        configs = compose_jobs(arguments)
        print_notes(configs, arguments)
        return run_jobs(configs, arguments.multirun)
    except Refused as reasons:
        print("error: this cannot be run", *(f"  {reason}" for reason in reasons.args), sep="\n", file=sys.stderr)
        return 2
    except BrokenPipeError:  # such as | head
        discard_output()
        print("the output is not read any more: stopped; the same command resumes", file=sys.stderr)
        return 1
    except OSError as error:
        if WANTS_TRACEBACKS or explain(error) is None:
            raise
        print(f"error: {explain(error)}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    complete_standard_streams()
    # after Ctrl-C, joblib's helper process frees what its workers held, with warnings that say nothing to a user
    quiet = "ignore:resource_tracker:UserWarning"
    # and joblib replaces a worker whose memory has grown by 300 MB, as between two trainings
    warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
    os.environ["PYTHONWARNINGS"] = ",".join(filter(None, [os.environ.get("PYTHONWARNINGS"), quiet]))
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # like Ctrl-C: the workers of a sweep end with it
    try:
        sys.exit(command_line())
    except KeyboardInterrupt:
        print("\ninterrupted: the same command resumes", file=sys.stderr)
        sys.exit(130)
