"""A run directory, below an outputs directory: one network, trained and evaluated, or a baseline.

runs/exp3/unet/projection/seed0/
    config.yaml      everything that determines its result (`RunConfig`), written first
    provenance.json  its status, and one entry per step: recordings, commit, hardware, versions, time
    history.csv      one row per epoch
    model/           best weights with their encoding and grid; `learning.networks.trained` reads them
    predictions.npz  probability of free on the test set, quantized to uint8
    metrics.csv      pooled test metrics, one row
    per_image.csv    metrics of every test image
    checkpoints/     of an unfinished training
"""

import dataclasses
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from pydantic import TypeAdapter

from repro.metrics.headings import METRICS
from repro.runs.config import RunConfig, differences
from repro.runs.provenance import Provenance, Status, changed_since, environment
from repro.system.errors import InputError
from repro.system.files import clear_leftovers, first_line, lock, read_typed, sha256, write_json, write_text

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Run:
    """One run directory."""

    path: Path

    def __str__(self) -> str:
        return str(self.path)

    @property
    def model(self) -> Path:
        return self.path / "model"

    @property
    def metrics(self) -> Path:
        return self.path / "metrics.csv"

    def read_metrics(self) -> "pd.Series":
        """Return the pooled metrics of an evaluated run; those that are younger than the evaluation are not there.

        Raises:
            InputError: metrics.csv cannot be read.
        """
        self.check_file(self.metrics.name)
        fix = f"{'delete it and ' if self.metrics.is_file() else ''}run the same command with task=evaluate"
        return read_table(self.metrics, METRICS, fix).iloc[0]

    @property
    def evaluate_again(self) -> str:
        """What to do where a file of the evaluation is wrong, for messages."""
        return f"delete {self.metrics} and run the same command with task=evaluate"

    def check_file(self, name: str) -> Path:
        """Return the path of a file that evaluation wrote, verified against its checksum.

        Raises:
            InputError: the file differs from the one that was written.
        """
        path = self.path / name
        expected = (self.provenance().fact("files") or {}).get(name)
        if expected and path.is_file() and sha256(path) != expected:
            raise InputError(f"{path} is not what was evaluated: {self.evaluate_again}")
        return path

    def check_files(self) -> None:
        """Check that the weights and the results of an evaluated run are those that were written.

        Raises:
            InputError: a file is missing, differs from its checksum or cannot be read; the message names the remedy.
        """
        origin, weights = self.provenance(), self.model / "model.safetensors"
        for name in origin.fact("files") or {}:
            if not self.check_file(name).is_file():
                raise InputError(f"{self.path / name} is missing: {self.evaluate_again}")
        self.read_metrics()
        expected = origin.fact("weights_sha256")
        if expected and not (weights.is_file() and sha256(weights) == expected):
            found = "is not what was trained" if weights.is_file() else "is missing"
            raise InputError(f"{weights} {found}: delete {self} and run the same command")

    @property
    def has_begun(self) -> bool:
        """Whether it is a run; before, the directory may have a log alone."""
        return any((self.path / name).is_file() for name in ("config.yaml", "provenance.json"))

    @contextmanager
    def exclusive(self) -> Iterator[None]:
        """Lock the directory and delete the partially written files of killed processes."""
        with lock(self.path):
            clear_leftovers(self.path)
            yield

    def prepare(self, config: RunConfig) -> None:
        """Create the directory and its config.yaml, or check that an existing one holds the same run.

        Raises:
            InputError: the directory holds a run of another configuration; the message names the differences.
        """
        if not self.has_begun:
            self.path.mkdir(parents=True, exist_ok=True)
            with self.exclusive():
                if not self.has_begun:  # another process may have created it meanwhile
                    content = TypeAdapter(RunConfig).dump_python(config)
                    write_text(self.path / "config.yaml", yaml.safe_dump(content, sort_keys=False))
        self.check(config)

    def check(self, config: RunConfig) -> None:
        """Check that the directory is empty or holds the run of this configuration.

        Raises:
            InputError: the directory holds a run of another configuration; the message names the differences.
        """
        if not self.has_begun:
            return
        listing = differences(self.config(), config)
        if listing:
            raise InputError(f"{self} holds a run of another configuration ({listing}): delete it or set outputs=")

    def config(self) -> RunConfig:
        """Read the configuration of the run.

        Raises:
            InputError: this is not a run directory, or its config.yaml cannot be read.
        """
        if not self.has_begun:
            raise InputError(f"{self} is not a run directory: it has no config.yaml")
        return read_typed(RunConfig, self.path / "config.yaml", self._fix)

    def provenance(self) -> Provenance:
        """Read the provenance of the run; empty if no step has begun."""
        path = self.path / "provenance.json"
        if not path.is_file() and not self.model.exists():
            return Provenance()
        return read_typed(Provenance, path, self._fix)

    @property
    def _fix(self) -> str:
        return f"restore it, or delete {self} to start the run again"

    @property
    def status(self) -> Status:
        return self.provenance().status

    @property
    def command(self) -> str | None:
        """The command of the call that works on the run, from the overrides that Hydra stores; None without Hydra."""
        path = self.path / ".hydra" / "overrides.yaml"
        typed = yaml.safe_load(path.read_text(encoding="utf-8")) if path.is_file() else None
        if not isinstance(typed, list) or not all(isinstance(word, str) for word in typed):
            return None
        return f"python run.py {shlex.join(typed)}"

    @property
    def is_trained(self) -> bool:
        return self.status in (Status.trained, Status.evaluated)

    def check_trained(self) -> None:
        """Refuse a run that is not trained, with an `InputError`."""
        if not self.is_trained:
            raise InputError(f"{self} is not fully trained: train it with task=train first")

    @property
    def is_evaluated(self) -> bool:
        """Whether the run has its metrics; if metrics.csv is lost, the next evaluation writes it again."""
        return self.status is Status.evaluated and self.metrics.is_file()

    @property
    def done(self) -> str:
        """Return the run, and whether its code has changed since, for a message that there is nothing to do."""
        return f"{self}{changed_since(self.provenance().last('trained'))}"

    def begin_step(self, step: str, status: Status, **facts: Any) -> None:
        """Add an entry for a new step, with time, versions, hardware and commit."""
        steps = [*self.provenance().steps, {"step": step, **facts, **environment()}]
        self._write(Provenance(status, None, steps))

    def end_step(self, status: Status, error: str | None = None, **facts: Any) -> None:
        """Add facts to the entry of the last step that this process began."""
        *before, last = self.provenance().steps
        self._write(Provenance(status, error, [*before, {**last, **facts}]))

    def use_recordings(self, fingerprint: str) -> None:
        """Store the fingerprint of the recordings that the run uses, or check that it has not changed.

        Raises:
            InputError: the run was started with other recordings.
        """
        used = self.provenance().fact("recordings")
        if used not in (None, fingerprint):
            raise InputError(f"{self} was started with other recordings: delete it and train again")
        if used is None:
            self.begin_step("recorded", self.status, recordings=fingerprint)

    def _write(self, provenance: Provenance) -> None:
        content = dataclasses.asdict(provenance)
        if provenance.error is None:
            del content["error"]
        write_json(self.path / "provenance.json", content)


def read_table(path: Path, columns: tuple[str, ...], fix: str) -> "pd.DataFrame":
    """Read a CSV file that has at least one row and the required columns.

    Args:
        columns: the required columns, which must not have missing values.
        fix: what to do if the file cannot be read; appended to the message.

    Raises:
        InputError: the file is missing, truncated, empty, or lacks a column or a value.
    """
    import pandas as pd  # slow to import, and recording does not need it

    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read ({first_line(error)}): {fix}") from error
    missing = [name for name in columns if name not in table]
    if missing or table.empty or table[list(columns)].isna().any(axis=None):
        problem = f"it lacks {', '.join(missing)}" if missing else "it lacks values"
        raise InputError(f"{path} cannot be read ({problem}): {fix}")
    return table
