import pytest

from repro.runs.keys import RunKey, lowest_seeds

KEYS = (RunKey("3", "unet", "projection-no-decay", 2**32 - 1), RunKey("office_2", "all_free"), RunKey("seed1", "seed2"))


@pytest.mark.parametrize("key", KEYS)
def test_the_path_of_a_key_is_parsed_to_the_key(key):
    assert RunKey.parse(key.path) == RunKey.parse(str(key.path)) == key
    assert key.is_baseline == (key.path.parts[0] == "baselines")


@pytest.mark.parametrize(
    "path",
    [
        "",
        "runs/exp3/unet/projection",
        "runs/exp3/unet/projection/seed-1",
        "runs/exp3/unet/projection/copy1",
        "runs/exp3/unet/projection/seed0/model",
        "runs/3/unet/projection/seed0",
        "outputs/laptop/runs/exp3/unet/projection/seed0",
        "baselines/exp3/tracker/seed0",
    ],
)
def test_other_paths_are_refused(path):
    with pytest.raises(ValueError, match=r"expected runs/exp<name>/<model>/<encoding>/seed<n> or .*, got"):
        RunKey.parse(path)


def test_the_lowest_seed_of_each_cell_is_chosen():
    keys = [RunKey("3", "unet", "projection", seed) for seed in (2, 1)]
    others = [RunKey("3", "unet", "series10", 3), RunKey("4", "unet", "projection", 0), RunKey("3", "tracker")]
    assert set(lowest_seeds([*keys, *others])) == {keys[1], *others}
