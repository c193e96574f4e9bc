"""One entry point: maps a task to one function of `repro`. The only file that knows Hydra.

python run.py task=record exp=3                                        simulate and store one experiment
python run.py exp=3 model=unet                                         record what is missing, train, evaluate
python run.py -m model=unet,fpn,upernet,segformer exp=3,4 decay=false  a sweep, then the tables
python run.py task=report                                              tables and figures from what is there
python run.py task=world exp=3 seed=17                                 write one world and its twin as IR-SIM YAML
"""

import os
import signal
import sys
import traceback
import uuid
from pathlib import Path
from typing import Any, ClassVar

import hydra
from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from repro.checks import all_faults, remarks
from repro.config import Config, Task, plain, schema, to_typed, variant
from repro.messages import JobFailed, explain, stopped
from repro.outcomes import print_tables
from repro.runs import Outputs
from repro.tasks import ONCE, TASKS, warn_of_cost

WANTS_TRACEBACKS = bool(os.environ.get("HYDRA_FULL_ERROR"))
FAILURES = "REPRO_FAILURES"  # names the file in which the jobs of a sweep, in whatever process, note their failures


def place(task: Task, exp: str, model: str, encoding: str, decay: bool, seed: int) -> str:
    """Says where a call's own files, and so Hydra's, lie below the outputs directory."""
    outputs = Outputs(Path())
    if task in (Task.all, Task.train, Task.evaluate):
        return str(outputs.run(exp, model, variant(encoding, decay), seed).path)
    return str(outputs.recordings(exp)) if task is Task.record else "hydra"


OmegaConf.register_new_resolver("place", place, replace=True)
ConfigStore.instance().store(name="schema", node=schema())


class Gate(Callback):
    """Checks a call, or every job of a sweep, before Hydra writes anything; notes whose tables are due at the end."""

    due: ClassVar[list[Outputs]] = []

    def on_run_start(self, config: DictConfig, **_: Any) -> None:
        check([config])

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        jobs = [hydra.compose("config", overrides=words) for words in jobs_of(config.hydra.overrides.task)]
        check(jobs)
        if config.task in (Task.all, Task.evaluate):
            self.due.append(Outputs(Path(config.outputs)))
        os.environ[FAILURES] = str(Path(config.outputs).absolute() / f".failures-{uuid.uuid4().hex}")


def jobs_of(overrides: list[str]) -> list[list[str]]:
    """Splits the words of a sweep into those of its jobs."""
    jobs: list[list[str]] = [[]]
    for override in OverridesParser.create().parse_overrides(list(overrides)):
        key = override.get_key_element()
        is_sweep = override.is_discrete_sweep()
        values = list(override.sweep_string_iterator()) if is_sweep else [override.get_value_element_as_str()]
        jobs = [[*job, f"{key}={value}"] for value in values for job in jobs]
    return jobs


def check(configs: list[DictConfig]) -> None:
    """Ends the call with status 2 and a list of all that is wrong with its configurations, if anything is."""
    values = [
        plain(OmegaConf.masked_copy(config, [str(key) for key in config if key != "hydra"])) for config in configs
    ]
    faults = dict.fromkeys(str(fault) for each in values for fault in all_faults(each))
    if len({config.outputs for config in configs}) < len(configs) and configs[0].task in ONCE:
        faults[f"task={configs[0].task.value}: is done once for all runs; leave out the sweep"] = None
    if faults:
        print("error: this cannot be run", *(f"  {fault}" for fault in faults), sep="\n", file=sys.stderr)
        sys.exit(2)
    typed = [to_typed(each) for each in values]
    for remark in dict.fromkeys(remark for each in typed for remark in remarks(each)):
        print(f"note: {remark}", file=sys.stderr)
    warn_of_cost(typed)


@hydra.main(version_base="1.3", config_path="conf", config_name="config")
def main(config: DictConfig) -> None:
    call = to_typed(plain(config))
    try:
        TASKS[call.task](call)
    except JobFailed:
        raise
    except Exception as error:
        fail(call, error)


def fail(config: Config, error: Exception) -> None:
    """Says why a job failed, notes it for the end of the sweep, and lets the other jobs go on."""
    message = explain(error)
    if message is None or WANTS_TRACEBACKS:
        traceback.print_exception(error)
    job = f"exp={config.exp} model={config.model.name} decay={str(config.decay).lower()} seed={config.seed}"
    line = (message or f"{type(error).__name__}: {error}").split("\n")[0]
    print(f"error: {message or line}", file=sys.stderr, flush=True)
    if FAILURES in os.environ:
        with open(os.environ[FAILURES], "a") as file:
            file.write(f"{job}: {line}\n")
    raise JobFailed(line) from None


def command_line() -> int:
    """Runs the call; returns its exit status: 1 when a job failed, 2 when it cannot be run, 130 when interrupted."""
    os.environ["HYDRA_FULL_ERROR"] = "1"  # errors come here, not to Hydra
    status = 0
    try:
        main()
    except JobFailed:
        status = 1
    except (HydraException, OmegaConfBaseException) as error:
        if WANTS_TRACEBACKS:
            raise
        print(f"error: {error}", *filter(None, [error.__cause__]), sep="\n", file=sys.stderr)
        return 2
    except OSError as error:
        if WANTS_TRACEBACKS or explain(error) is None:
            raise
        print(f"error: {explain(error)}", file=sys.stderr)
        return 1
    left_out = [print_tables(outputs) for outputs in Gate.due]
    return max([status, print_failures(), *left_out])


def print_failures() -> int:
    """Lists the failed jobs of a sweep, one line each; returns 1 when there are some."""
    path = Path(os.environ.get(FAILURES, ""))
    if not path.is_file():
        return 0
    print("failed:", *(f"  {line}" for line in path.read_text().splitlines()), sep="\n", file=sys.stderr)
    path.unlink()
    return 1


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # like Ctrl-C: the workers of a sweep end with it
    try:
        sys.exit(command_line())
    except KeyboardInterrupt:
        print(f"\n{stopped()}", file=sys.stderr)
        sys.exit(130)
