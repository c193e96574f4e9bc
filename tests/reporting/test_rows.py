import json
import shutil
from collections.abc import Callable

import pandas as pd
import pytest
from conftest import fake_study

from repro.reporting.documents import with_results
from repro.reporting.publish import publish
from repro.reporting.results import keys_of, read_origins, read_published, read_rows
from repro.runs.outputs import Outputs


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Publish a small study."""
    path = tmp_path_factory.mktemp("rows")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("repro.runs.provenance._commit", lambda: "0123abc")
        fake_study(path / "laptop")
    return publish(Outputs(path / "laptop"), path / "results")


@pytest.fixture
def published(whole, tmp_path):
    """Return a copy of the published study, to be damaged."""
    return shutil.copytree(whole, tmp_path / "results" / "laptop")


def edited(name: str, value: str, line: int = 2) -> Callable[[str], bytes]:
    """Return a function that replaces one value of the text of a CSV file, in a line from 1."""

    def edit(text: str) -> bytes:
        lines = text.splitlines()
        cells = lines[line - 1].split(",")
        cells[lines[0].split(",").index(name)] = value
        return "\n".join([*lines[: line - 1], ",".join(cells), *lines[line:]]).encode()

    return edit


DAMAGES = {
    "blank metric": (edited("accuracy", ""), "one row per run, with accuracy from -1 to 1"),
    "infinite metric": (edited("dice", "inf", 4), "with dice from -1 to 1"),
    "text in a number": (edited("accuracy", "abc"), "with accuracy from -1 to 1"),
    "decimal comma": (edited("accuracy", "0,895", 4), "Error tokenizing data"),
    "decimal comma in the first row": (edited("accuracy", "0,895"), "cannot safely cast|more values"),
    "text as seed": (edited("seed", "x", 3), "seed|x|convert"),
    "half a seed": (edited("seed", "0.5", 3), "cannot safely cast"),
    "no header": (lambda text: text.split("\n", 1)[1].encode(), "lacks the columns experiment, model"),
    "no rows": (lambda text: text.split("\n")[0].encode(), "expected one row per run"),
    "a row twice": (lambda text: (text + text.splitlines()[2]).encode(), "expected one row per run"),
    "UTF-16": (lambda text: text.encode("utf-16"), "codec can't decode"),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_published_runs_that_are_damaged_are_refused(name, published):
    damage, message = DAMAGES[name]
    path = published / "runs.csv"
    path.write_bytes(damage(path.read_text()))
    with pytest.raises(ValueError, match=rf"laptop/runs\.csv cannot be read \(.*({message}).*\): restore"):
        with_results("<!-- results: laptop main -->\n<!-- end -->", published.parent)


def test_a_run_without_provenance_is_named(published):
    path, name = published / "provenance.json", "runs/exp3/unet/projection/seed0"
    whole = json.loads(path.read_text())
    keys = keys_of(read_published(published))
    path.write_text(json.dumps({key: value for key, value in whole.items() if key != name}))
    with pytest.raises(ValueError, match=rf"provenance\.json cannot be read \(it lacks 1 runs .*{name}"):
        read_origins(published, keys)
    for steps in ([], [{}]):
        path.write_text(json.dumps({**whole, name: {**whole[name], "steps": steps}}))
        with pytest.raises(ValueError, match=rf"provenance\.json cannot be read \({name}: expected steps with names"):
            read_origins(published, keys)
    path.write_text(json.dumps({**whole, "unet": whole[name]}))
    with pytest.raises(ValueError, match=r"provenance\.json cannot be read \(expected runs/exp<name>.*got unet\)"):
        read_origins(published, keys)


def test_rows_keep_the_names_of_experiments_and_baselines(tmp_path):
    path = tmp_path / "rows.csv"
    path.write_text("experiment,model,encoding,seed,value\n01,unet,projection,0,0.5\n3,all_free,,,inf\n")
    rows = read_rows(path)
    assert rows["experiment"].tolist() == ["01", "3"]
    assert rows["encoding"].tolist() == ["projection", ""]
    assert rows["seed"].tolist() == [0, pd.NA]
