import torch

from repro.networks.create import architecture_of, create_network, load_network
from repro.networks.deeptracking import DeepTracking
from repro.networks.model import Model


def test_the_network_has_the_parameters_of_the_published_one():
    assert sum(p.numel() for p in DeepTracking(4, frames=2).parameters()) == 78_449


def test_a_longer_series_needs_no_more_parameters():
    assert len({sum(p.numel() for p in DeepTracking(2 * n, n).parameters()) for n in (2, 4, 10)}) == 1


def test_a_series_is_mapped_to_one_map_of_logits():
    network, images = create_network(Model("deeptracking"), in_channels=8, frames=4).eval(), torch.rand(2, 8, 32, 48)
    with torch.no_grad():
        logits = network(images)
        network.to_map.bias.sub_(2)
        assert torch.allclose(network(images), logits - 2, atol=1e-5)  # no sigmoid at the end
    assert logits.shape == (2, 1, 32, 48)


def test_the_state_is_updated_from_the_oldest_part_to_the_newest():
    torch.manual_seed(0)
    network, hits, free = DeepTracking(4, frames=2).eval(), torch.rand(1, 2, 32, 32), torch.rand(1, 2, 32, 32)
    with torch.inference_mode():
        state = torch.zeros(1, 32, 32, 32)
        for part in range(2):
            seen = network.encoder(torch.stack([hits[:, part], free[:, part]], dim=1)).sigmoid()
            state = network.transition(torch.cat([seen, state], dim=1)).sigmoid()
        expected = network.to_map(state)
        assert torch.allclose(network(torch.cat([hits, free], dim=1)), expected, atol=1e-6)


def test_the_map_after_a_part_is_that_of_the_series_up_to_it():
    torch.manual_seed(0)
    network, images = DeepTracking(8, frames=4).eval(), torch.rand(1, 8, 16, 16)
    with torch.inference_mode():
        maps = network(images, every_part=True)
        assert torch.equal(maps[:, 3:], network(images))
        network.frames = 2
        assert torch.allclose(maps[:, 1:2], network(images[:, [0, 1, 4, 5]]), atol=1e-6)


def test_a_network_is_saved_and_loaded(tmp_path):
    network, images = DeepTracking(8, frames=4).eval(), torch.rand(1, 8, 32, 32)
    network.save_pretrained(tmp_path)
    assert architecture_of(network) == "deeptracking"
    with torch.inference_mode():
        assert torch.equal(network(images), load_network(tmp_path, "deeptracking").eval()(images))
