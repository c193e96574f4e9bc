"""task=navigate as it is called: with a trained network, and what is refused."""

import pandas as pd
import pytest
from conftest import ROOT, TINY, read_calls

from repro.cli.jobs import Job
from repro.navigation import trials
from repro.system.errors import InputError

pytestmark = pytest.mark.slow

FEW = ["navigation.validation_seeds=1", "navigation.test_seeds=2"]


def run(outputs, *arguments) -> None:
    words = ["world=navigation", "exp=mixed", *TINY, f"outputs={outputs}"]
    (call,) = read_calls(*words, *arguments)
    call.facts.run(Job(call))


@pytest.fixture(scope="module")
def outputs(tmp_path_factory):
    directory = tmp_path_factory.mktemp("navigation") / "first"
    with pytest.MonkeyPatch.context() as context:
        context.chdir(ROOT)
        run(directory, "task=record")
        run(directory, "task=train")
    return directory


@pytest.fixture(autouse=True)
def one_candidate(monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(trials, "INFLATIONS_M", (1.6,))
    monkeypatch.setattr(trials, "WEIGHTS", (20.0,))


def navigate(outputs, mapper, *arguments) -> None:
    run(outputs, "task=navigate", f"navigation.mapper={mapper}", *FEW, "navigation.experiments=[static]", *arguments)


def test_arms_are_driven_and_compared(outputs):
    navigate(outputs, "keep")
    navigate(outputs, "network", f"prediction.weights={outputs}/runs/expmixed/unet/projection/seed0")
    rows = pd.read_csv(outputs / "analysis" / "navigation.csv")
    assert list(rows["mapper"]) == ["keep", "unet-projection"] * 2
    assert list(rows["episodes"]) == [2] * 4
    assert rows.loc[0, "settings"] == "inflation_m=1.6 weight=20"
    assert rows.loc[1, "settings"].startswith("inflation_m=1.6 weight=20")
    assert (outputs / "analysis" / "navigation.png").is_file()
    assert (outputs / "analysis" / "navigation.json").is_file()


def test_a_network_of_other_maps_is_refused(outputs):
    with pytest.raises(InputError, match="expected maps of 32 px, 50 m, got 128 px, 25 m"):
        navigate(outputs, "network", "prediction.weights=rooms")
