import torch

from repro.networks.convlstm import ConvLSTM
from repro.networks.create import architecture_of, create_network, load_network
from repro.networks.model import Model


def test_a_series_of_images_is_mapped_to_one_map_of_logits():
    network = create_network(Model("convlstm"), in_channels=4, frames=4).eval()
    with torch.inference_mode():
        assert network(torch.rand(2, 4, 64, 96)).shape == (2, 1, 64, 96)


def test_the_order_of_the_images_matters():
    images = torch.rand(1, 4, 32, 32)
    torch.manual_seed(0)
    network = ConvLSTM(4, 4).eval()
    with torch.inference_mode():
        assert not torch.allclose(network(images), network(images.flip(1)))


def test_a_longer_series_needs_no_more_parameters():
    assert len({sum(p.numel() for p in ConvLSTM(frames, frames).parameters()) for frames in (2, 4, 10)}) == 1


def test_the_first_image_affects_the_prediction():
    images = torch.zeros(2, 4, 32, 32)
    images[1, 0, 10:20, 10:20] = 1
    torch.manual_seed(0)
    with torch.inference_mode():
        empty, shown = ConvLSTM(4, 4).eval()(images)
    assert (empty - shown).abs().max() > 1e-3


def test_a_convlstm_is_saved_and_loaded(tmp_path):
    network, images = ConvLSTM(4, 4, hidden=16).eval(), torch.rand(1, 4, 32, 32)
    network.save_pretrained(tmp_path)
    with torch.inference_mode():
        assert torch.equal(network(images), load_network(tmp_path, architecture_of(network)).eval()(images))
