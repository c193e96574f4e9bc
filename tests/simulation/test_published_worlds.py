import hashlib
import json

import numpy as np
import pytest
from conftest import ROOT

from repro.recordings.format import spec_fingerprint
from repro.simulation.sampling import reverse_direction, sample_world
from repro.simulation.simulator import simulate
from repro.worlds.spec import read_world, world_spec

PUBLISHED = {  # by world and experiment: starts of the fingerprint, of the hashes of worlds, and of two recordings
    ("paper", "1"): ("d4c75e9db2a32d28", "761a940523c8f985", "096a6800c192d51c"),
    ("paper", "2"): ("3d26674893cb7e1b", "31f4b26bf16fe87d", "75a679d4cccf69b2"),
    ("paper", "3"): ("ac4515e113894174", "548c1323c2e8768a", "4fed66b729077f01"),
    ("paper", "4"): ("62e6534e967821d0", "1c7794ec8125ab25", "94627cd22299a09e"),
    ("drive", "static"): ("e3e7d9beb5eff258", "1bb1c6f62d66082e", "f69b1223b740c2df"),
    ("drive", "moving"): ("eb8779168eb0f4bb", "a7ac735bfc854b79", "609e4c6092d1cc94"),
    ("drive", "mixed"): ("5daaab00909596f2", "3315091c7139b04d", "f6ff2ba0f73b91b0"),
    ("office", "people"): ("ce6e72805e27cf81", "16af48a306d9b09b", "7bc8cf1f4abfad99"),
    ("office", "furniture"): ("20a506206fc6b080", "ff3ff8be61dacae5", "8475f8b1682cd80a"),
    ("rooms", "people"): ("29f454489f981c70", "72323f562c9904c4", "6f5688d415735dad"),
}


def digest(content: object) -> str:
    floats = json.loads(json.dumps(content), parse_int=float)
    return hashlib.sha256(json.dumps(floats, sort_keys=True).encode()).hexdigest()[:16]


def recording_digest(worlds: list) -> str:
    recordings = [simulate(world) for world in worlds]
    arrays = [array for item in recordings for array in (item.scans.ranges, item.scans.poses, item.states)]
    return hashlib.sha256(b"".join(np.round(array, 4).astype(np.float32).tobytes() for array in arrays)).hexdigest()[
        :16
    ]


@pytest.mark.parametrize(("name", "experiment"), PUBLISHED)
def test_worlds_and_recordings_are_the_published_ones(name, experiment):
    spec = world_spec(read_world(ROOT / "conf" / "world" / f"{name}.yaml"), experiment)
    worlds = [
        world for seed in range(3) for world in (sample_world(spec, seed), reverse_direction(sample_world(spec, seed)))
    ]
    found = (spec_fingerprint(spec)[:16], digest(worlds), recording_digest(worlds[:2]))
    assert found == PUBLISHED[name, experiment]
