import hashlib
import json

import numpy as np
import pytest
from conftest import ROOT

from repro.recordings.format import spec_fingerprint
from repro.simulation.simulator import simulate
from repro.simulation.worlds import reverse_direction, sample_world
from repro.world_config import read_world, world_spec

PUBLISHED = {  # by world and experiment: starts of the fingerprint, of the hashes of worlds, and of two recordings
    ("paper", "1"): ("d4c75e9db2a32d28", "20a4965d306c9b57", "096a6800c192d51c"),
    ("paper", "2"): ("3d26674893cb7e1b", "88631e92868d80ce", "75a679d4cccf69b2"),
    ("paper", "3"): ("ac4515e113894174", "b7a1508283eec291", "4fed66b729077f01"),
    ("paper", "4"): ("62e6534e967821d0", "fe891cbae1b9709e", "94627cd22299a09e"),
    ("drive", "static"): ("e3e7d9beb5eff258", "94bf794ea4ed32dc", "f69b1223b740c2df"),
    ("drive", "moving"): ("eb8779168eb0f4bb", "c1db7aff32f421a8", "609e4c6092d1cc94"),
    ("drive", "mixed"): ("5daaab00909596f2", "e1d12326abc9f673", "f6ff2ba0f73b91b0"),
    ("office", "people"): ("ce6e72805e27cf81", "7e9e5b3c99bf51b2", "7bc8cf1f4abfad99"),
    ("office", "furniture"): ("20a506206fc6b080", "7fbe993e7d6fe516", "8475f8b1682cd80a"),
    ("rooms", "people"): ("29f454489f981c70", "57bba8a1d7b9fd0c", "6f5688d415735dad"),
}


def digest(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


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
