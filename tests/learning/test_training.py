from functools import partial

import pandas as pd
import pytest
import segmentation_models_pytorch as smp
import torch
from conftest import prepared, spent_budget

from repro.learning.losses import MapLoss
from repro.learning.networks.create import OWN_ARCHITECTURES
from repro.learning.networks.trained import load_trained, module_of
from repro.learning.training import train
from repro.recordings.datasets import Batches, load_pairs_of_run
from repro.recordings.reader import open_recordings
from repro.runs.directories import Run
from repro.runs.provenance import Status
from repro.system.errors import InputError
from repro.system.files import sha256


def begin(path, recorded, **changes):
    """Prepare a small run and train it to its end."""
    return train(prepared(path, **changes), recorded, accelerator="cpu")


def same_weights(first, second):
    one, two = (smp.from_pretrained(path / "model").state_dict() for path in (first, second))
    return all(torch.equal(one[key], two[key]) for key in one)


def losses(path):
    return pd.read_csv(path / "history.csv")[["epoch", "train_loss", "val_loss"]]


@pytest.fixture(scope="module")
def finished(recorded, tmp_path_factory):
    """Train a run of three epochs without interruption."""
    path = tmp_path_factory.mktemp("finished")
    assert begin(path, recorded, max_epochs=3) is Status.trained
    return path


@pytest.mark.slow
def test_a_finished_run_has_history_provenance_and_weights(finished, recorded):
    history, origin = losses(finished), Run(finished).provenance()
    assert history["epoch"].tolist() == list(range(3))
    assert history["train_loss"].iloc[-1] < history["train_loss"].iloc[0]
    assert (origin.status, origin.fact("epochs"), origin.fact("train_pairs")) == (Status.trained, 3, 24)
    assert origin.fact("weights_sha256") == sha256(finished / "model" / "model.safetensors")
    assert not (finished / "checkpoints").exists()


@pytest.mark.slow
def test_same_seed_same_weights_other_seed_other_weights(finished, recorded, tmp_path):
    begin(tmp_path / "again", recorded, max_epochs=3)
    begin(tmp_path / "other", recorded, max_epochs=3, seed=1)
    assert same_weights(finished, tmp_path / "again")
    assert losses(finished).equals(losses(tmp_path / "again"))
    assert not same_weights(finished, tmp_path / "other")


@pytest.mark.slow
def test_the_average_of_the_weights_is_validated_saved_and_resumed(recorded, tmp_path):
    settings = {"max_epochs": 3, "flip_augmentation": True, "ema_decay": 0.9}
    assert begin(tmp_path / "whole", recorded, **settings) is Status.trained
    run = prepared(tmp_path / "parts", **settings)
    for _ in range(3):
        status = train(run, recorded, accelerator="cpu", budget=spent_budget())
    assert status is Status.trained
    assert losses(run.path).equals(losses(tmp_path / "whole"))
    assert same_weights(run.path, tmp_path / "whole")

    # the saved weights are those with the lowest validation loss
    val = load_pairs_of_run(open_recordings(recorded), "val", run.config(), "cpu")
    network = module_of(load_trained(run.model))
    with torch.inference_mode():
        parts = [MapLoss()(network(image), target) for image, target in Batches(val, 8)]
    assert losses(run.path)["val_loss"].min() == pytest.approx(torch.stack(parts).mean().item(), abs=2e-3)

    begin(tmp_path / "plain", recorded, **{**settings, "ema_decay": None})
    assert not same_weights(run.path, tmp_path / "plain")


@pytest.mark.slow
def test_a_spent_budget_pauses_after_an_epoch_and_the_next_call_resumes(finished, recorded, tmp_path, capsys):
    run, calls = prepared(tmp_path / "paused", max_epochs=3), 0
    used = spent_budget()
    used.epochs = 1
    assert train(run, recorded, accelerator="cpu", budget=used) is Status.paused
    assert run.status is Status.prepared  # nothing was begun
    while True:
        calls += 1
        if train(run, recorded, accelerator="cpu", budget=spent_budget()) is Status.trained:
            break
        assert run.status is Status.paused
        assert len(losses(run.path)) == run.provenance().fact("epochs") == calls
    assert calls == 3
    assert same_weights(finished, run.path)
    announced = [line.split("  ")[1] for line in capsys.readouterr().out.splitlines() if "resuming" in line]
    assert announced == [f"resuming after epoch {epoch} of 3" for epoch in range(1, 3)]


@pytest.mark.slow
@pytest.mark.parametrize(("patience", "epochs"), [(0, 2), (2, 3)])
def test_early_stopping_counts_epochs_without_improvement(recorded, tmp_path, patience, epochs):
    begin(tmp_path, recorded, max_epochs=40, patience=patience, min_delta=10.0)
    assert losses(tmp_path)["epoch"].tolist() == list(range(epochs))
    assert (tmp_path / "model" / "model.safetensors").is_file()


@pytest.mark.slow
def test_a_training_starts_from_the_weights_of_another_network(finished, recorded, tmp_path):
    begin(tmp_path / "on", recorded, max_epochs=1, weights=str(finished / "model"))
    assert losses(tmp_path / "on")["train_loss"].iloc[0] < losses(finished)["train_loss"].iloc[2]


def test_weights_of_a_network_of_another_form_are_refused(recorded, tmp_path):
    with pytest.raises(InputError, match=r"train.weights=rooms: expected a network of the same form"):
        begin(tmp_path, recorded, weights="rooms")


@pytest.mark.slow
def test_the_best_weights_are_saved_also_of_a_run_that_is_moved_while_paused(recorded, tmp_path, monkeypatch):
    forward, run = MapLoss.forward, prepared(tmp_path / "start", max_epochs=3, learning_rate=0.02)
    for number, by in enumerate((1e3, 0.0, 1e3)):  # by how much each validation is worse
        monkeypatch.setattr(MapLoss, "forward", lambda own, *maps, by=by: forward(own, *maps) + by * (not own.training))
        train(run, recorded, accelerator="cpu", budget=spent_budget())
        run = Run(run.path.rename(tmp_path / str(number)))
    monkeypatch.undo()
    begin(tmp_path / "short", recorded, max_epochs=2, learning_rate=0.02)
    assert same_weights(run.path, tmp_path / "short")


@pytest.mark.parametrize("kind", ["training", "validation"])
def test_a_loss_that_is_not_finite_fails_the_run(recorded, tmp_path, monkeypatch, kind):
    forward = MapLoss.forward

    def poisoned(self, logits, target):
        return forward(self, logits, target) * (float("nan") if self.training == (kind == "training") else 1.0)

    monkeypatch.setattr(MapLoss, "forward", poisoned)
    place = "the loss is nan at epoch 0, batch 0" if kind == "training" else "the validation loss is nan at epoch 0"
    with pytest.raises(FloatingPointError, match=place):
        begin(tmp_path, recorded)
    assert Run(tmp_path).status is Status.failed
    assert place in Run(tmp_path).provenance().error
    assert not (tmp_path / "model").exists()


def test_a_run_is_not_continued_with_other_recordings(recorded, tmp_path):
    run = prepared(tmp_path)
    run.use_recordings("of another day")
    with pytest.raises(ValueError, match="started with other recordings"):
        train(run, recorded)


def test_a_network_that_cannot_be_used_is_refused_before_the_training(recorded, tmp_path, monkeypatch):
    monkeypatch.setitem(OWN_ARCHITECTURES, "plain", partial(torch.nn.Conv2d, out_channels=1, kernel_size=1))
    run = prepared(tmp_path, model="plain", encoder_name=None)
    with pytest.raises(ValueError, match="Conv2d must save itself"):
        train(run, recorded, accelerator="cpu")
    assert run.status is Status.prepared
