"""The command line: a call is composed by Hydra, checked as a whole, and its jobs are run."""

import argparse
import logging
import os
import signal
import sys
import traceback
import warnings
from pathlib import Path

import hydra
from omegaconf import DictConfig

from repro.cli.call import Call, read_call
from repro.cli.compose import Composed, composed, launch
from repro.cli.jobs import Job
from repro.cli.refusals import WANTS_TRACEBACKS, Refused, explain
from repro.cli.tasks import keys_without_effect
from repro.runs.outputs import Outputs
from repro.runs.parallel import has_gpu, use_one_thread
from repro.system.errors import InputError, printable
from repro.system.project import conf_directory
from repro.worlds.spec import plain

USAGE = """Usage: repro task=<task> [key=value ...], in a checkout python run.py; --help lists the tasks and keys.

repro task=predict scans=examples/rooms.npz        maps from a log of your own robot
repro exp=3 model=unet scale=first                 record, train, evaluate: minutes (needs the study)
repro -m model=unet,fpn exp=3,4                    a sweep, then its table: hours on a CPU (needs the study)"""
OF_HYDRA = {"--help", "-h", "--hydra-help", "--version", "--cfg", "-c", "--info", "-i", "--shell-completion", "-sc"}
if sys.version_info >= (3, 14):  # which checks that the help of every option is text; one of Hydra 1.3.8 is none
    argparse.ArgumentParser._check_help = lambda *_: None  # type: ignore[attr-defined]


def main() -> int:
    """Run the call of the command line.

    Returns:
        0, 1 when a job failed, 2 when the call is refused, 130 when it is interrupted.
    """
    _prepare_process()
    try:
        _check_directory()
        return _run_call()
    except InputError as refused:
        print("error: this cannot be run", *(f"  {reason}" for reason in refused.args), sep="\n", file=sys.stderr)
        return 2
    except BrokenPipeError:  # such as | head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # takes what is still to be printed
        print("the output is not read any more: stopped; the same command resumes", file=sys.stderr)
        return 1
    except (ModuleNotFoundError, OSError) as error:
        if WANTS_TRACEBACKS or explain(error) is None:
            raise
        print(f"error: {explain(error)}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ninterrupted: the same command resumes", file=sys.stderr)
        return 130


def _prepare_process() -> None:
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed, as with 2>&-
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        getattr(sys, name).reconfigure(errors="backslashreplace")
    logging.raiseExceptions = False  # Hydra's log may go to an output that is not read any more
    os.environ["MPLBACKEND"] = "agg"  # figures are files; Jupyter names a backend that others cannot import
    # after Ctrl-C, joblib's helper process frees what its workers held, with warnings that say nothing to a user
    quiet = "ignore:resource_tracker:UserWarning"
    # and joblib replaces a worker whose memory has grown by 300 MB, as between two trainings
    warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
    os.environ["PYTHONWARNINGS"] = ",".join(filter(None, [os.environ.get("PYTHONWARNINGS"), quiet]))
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # like Ctrl-C: the workers of a sweep end with it


def _check_directory() -> None:
    try:
        os.getcwd()
    except FileNotFoundError as error:
        raise Refused("the working directory was deleted: change to another one") from error


def _run_call() -> int:
    if not sys.argv[1:]:
        print(USAGE)
        return 0
    if any(word.partition("=")[0] in OF_HYDRA for word in sys.argv[1:]):
        hydra.main(version_base="1.3", config_path=str(conf_directory()), config_name="config")(run_composed)()
        return 0
    arguments = read_arguments(sys.argv[1:])
    with composed(arguments) as jobs:
        calls = read_calls(arguments, jobs)
        _say_scale(calls[0], arguments.overrides)
        return _run_sweep(calls, jobs) if arguments.multirun else int(_run_one(calls[0], jobs[0]) is not None)


def read_arguments(words: list[str]) -> argparse.Namespace:
    """Read the options and overrides of a call.

    Raises:
        Refused: an option is unknown.
    """
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("overrides", nargs="*")
    parser.add_argument("-m", "--multirun", action="store_true")
    parser.add_argument("-cd", "--config-dir")
    arguments, unknown = parser.parse_known_args(words)
    if unknown:
        raise Refused(
            f"{' '.join(unknown)}: not understood: expected -m or --config-dir, then overrides without dashes, exp=3; "
            "--help lists them"
        )
    return arguments


def read_calls(arguments: argparse.Namespace, jobs: list[Composed]) -> list[Call]:
    """Return the typed calls of all jobs.

    Raises:
        Refused: a job cannot be run, or not beside the others.
    """
    calls: list[Call] = []
    errors: dict[str, None] = {}
    for job in jobs:
        try:
            calls.append(read_call(job.values))
        except Refused as refused:
            errors |= dict.fromkeys(refused.args)
    if errors:
        raise Refused(*errors)
    task, names = calls[0].task, dict.fromkeys(call.task for call in calls)
    if len(names) > 1:
        raise Refused(f"task={','.join(names)}: a sweep has one task; its jobs may run at the same time")
    if unused := keys_without_effect(task, arguments.overrides):
        raise Refused(*unused)
    if len({call.outputs for call in calls}) < len(calls) and calls[0].facts.once:
        raise Refused(f"task={task}: is done once for all runs; leave out the sweep")
    if shared := _shared_targets(calls, jobs):
        raise Refused(*shared)
    return calls


def _shared_targets(calls: list[Call], jobs: list[Composed]) -> list[str]:
    """Return which jobs of a sweep write to one place, of which the last one would remain or others would fail."""
    targets: dict[Path, list[Composed]] = {}
    for call, job in zip(calls, jobs, strict=True):
        if target := call.facts.target:
            targets.setdefault(target(Job(call)).absolute(), []).append(job)
    return [
        f"{len(sharing)} jobs write to {target}, such as {_name(sharing[0], sharing) or 'one'} and "
        f"{_name(sharing[1], sharing) or 'the same again'}: set outputs= for each"
        for target, sharing in targets.items()
        if len(sharing) > 1
    ]


def _say_scale(call: Call, overrides: list[str]) -> None:
    """Print the scale where it was not chosen, and that it is not meant for a CPU."""
    scale = call.scale
    if call.facts.names_scale and not any(override.startswith("scale=") for override in overrides):
        why = "a CUDA GPU is visible" if has_gpu() else "no CUDA GPU is visible"
        other = "laptop" if scale.name == "paper" else "paper"
        print(f"scale={scale.name} ({why}): {scale.size_px} px, the whole study takes {scale.takes}", flush=True)
        print(f"  the other default is scale={other}; scale=first takes minutes", flush=True)
    if call.facts.trains and scale.name == "paper" and not has_gpu():
        print("note: scale=paper takes days without a GPU; scale=laptop takes an hour or two", file=sys.stderr)


def _run_one(call: Call, job: Composed) -> str | None:
    if call.facts.place == "outputs":  # the task writes what it writes, and Hydra nothing beside it
        logging.basicConfig(format="%(message)s", stream=sys.stdout)
        logging.getLogger("repro").setLevel(logging.INFO)
        return perform(call)
    return job.run(lambda _: perform(call))


def _run_sweep(calls: list[Call], jobs: list[Composed]) -> int:
    """Run the jobs of a sweep by Hydra's launcher, then print its tables and failures; return the exit status."""
    for call in {call.outputs: call for call in calls if call.facts.trains}.values():
        Job(call).outputs.check_data(Job(call).config)  # which every job would refuse
    if not has_gpu():
        use_one_thread()
    results = launch(jobs, run_composed)
    failed = [f"  {_name(job, jobs)}: {line}" for job, line in zip(jobs, results, strict=True) if line]
    if calls[0].task in ("all", "evaluate"):
        from repro.cli.output import print_tables  # imports pandas

        tables = tuple({call.decay: "main" if call.decay else "ablation" for call in calls}.values())
        outputs = sorted({Path(call.outputs) for call in calls})
        for path in outputs:
            try:
                print_tables(Outputs(path), tables)
            except InputError as error:
                failed.append(f"  tables: {error}")
    if failed:
        print("failed:", *failed, sep="\n", file=sys.stderr)
    return int(bool(failed))


def _name(job: Composed, jobs: list[Composed]) -> str:
    """Return the overrides of a job that the others of its call do not share."""
    return " ".join(override for override in job.overrides if any(override not in other.overrides for other in jobs))


def run_composed(config: DictConfig) -> str | None:
    """Run a job of a sweep, in whatever process the launcher starts it."""
    return perform(read_call(plain(config)))


def perform(call: Call) -> str | None:
    """Run the task of a call; print and return why it failed, None if it did not."""
    try:
        call.facts.run(Job(call))
    except BrokenPipeError:
        raise
    except Exception as error:
        message = explain(error)
        if message is None or WANTS_TRACEBACKS:
            traceback.print_exception(error)
        line = (message or f"{type(error).__name__}: {error}").split("\n")[0]
        print(printable(f"error: {message or line}"), file=sys.stderr, flush=True)
        return line
    return None
