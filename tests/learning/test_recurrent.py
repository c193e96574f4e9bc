"""The recurrent networks: a map from a series of images, whose every image, time and order counts."""

import pytest
import torch

from repro.learning.checkpoints import start_from
from repro.learning.networks.convgru import ConvGRU, _distances
from repro.learning.networks.convlstm import ConvLSTM
from repro.learning.networks.create import create_network
from repro.learning.networks.trained import TorchNetwork, save_trained
from repro.maps.grid import Grid
from repro.maps.series import Series
from repro.networks.predictor import Predictor
from repro.runs.model import Model

both = pytest.mark.parametrize("network_class", [ConvGRU, ConvLSTM])


@pytest.mark.parametrize(
    ("name", "parameters"), [("convgru", {"stride": 2}), ("convgru", {"stride": 4}), ("convlstm", {})]
)
@pytest.mark.parametrize(("channels", "frames"), [(4, 4), (8, 4), (20, 10)])
def test_a_series_of_images_is_mapped_to_one_map_of_logits(channels, frames, name, parameters):
    network = create_network(Model(name, parameters={"hidden": 16, **parameters}), channels, frames).eval()
    with torch.inference_mode():
        assert network(torch.rand(2, channels, 64, 96)).shape == (2, 1, 64, 96)


@both
def test_every_image_affects_the_prediction(network_class):
    torch.manual_seed(0)
    network, images = network_class(8, 4).eval(), torch.zeros(9, 8, 32, 32)
    images[range(1, 9), range(8), 10:20, 10:20] = 1
    with torch.inference_mode():
        empty, *shown = network(images)
    assert all((empty - image).abs().max() > 1e-3 for image in shown)


@both
def test_the_prediction_depends_on_the_order_of_the_parts(network_class):
    """The layers that see the whole series are silenced, which leaves the state."""
    torch.manual_seed(0)
    network, images = network_class(8, 4, hidden=16).eval(), torch.rand(1, 8, 32, 32)
    backward = images.unflatten(1, (2, 4)).flip(2).flatten(1, 2)
    with torch.inference_mode():
        if network_class is ConvGRU:
            network.detail.weight.zero_()
            network.detail.bias.zero_()
        assert not torch.allclose(network(images), network(backward))


@both
def test_a_part_consists_of_the_images_of_the_same_time(network_class):
    """The state after one part is that of the hits and the free pixels of this part."""
    torch.manual_seed(0)
    network = network_class(8, 4, hidden=16).eval()
    received = []
    network.encoder.register_forward_hook(lambda _, inputs, __: received.append(inputs[0]))
    images = torch.arange(8.0).view(1, 8, 1, 1).expand(1, 8, 32, 32)
    with torch.inference_mode():
        network(images)
    assert received[0][:, :, 0, 0].tolist() == [[0, 4], [1, 5], [2, 6], [3, 7]]


@both
@pytest.mark.parametrize(
    ("channels", "frames", "message"),
    [(4, 1, "at least 2 parts, got 4 images in 1 parts"), (9, 4, "got 9 images in 4 parts")],
)
def test_a_series_that_is_none_is_refused(channels, frames, message, network_class):
    with pytest.raises(ValueError, match=message):
        network_class(channels, frames)


def test_a_network_with_distances_predicts_the_same_before_it_is_trained():
    network, images = ConvGRU(8, 4, hidden=16, stride=2), torch.rand(2, 8, 32, 32)
    assert torch.equal(network.with_distances().train()(images), network.train()(images))


def test_the_maps_of_a_turned_network_turn_with_their_images():
    network, images = ConvGRU(8, 4, hidden=16, centered=True, turned=True).eval(), torch.rand(2, 8, 32, 32)
    maps = network(images)
    assert torch.allclose(network(images.flip(-2, -1)), maps.flip(-2, -1), atol=1e-6)
    assert not torch.allclose(network.train()(images), maps, atol=1e-3)
    assert torch.equal(network.eval()(images, (16.0, 16.0)), maps)


def test_what_a_network_lacks_without_effect_it_lacks_after_another_trained_too(tmp_path):
    trained, images = ConvGRU(8, 4, hidden=16).eval(), torch.rand(2, 8, 32, 32)
    save_trained(Predictor(TorchNetwork(trained), Series(4), Grid(32, 25.0)), tmp_path / "model")
    network = ConvGRU(8, 4, hidden=16, indexed=True).eval()
    start_from(network, str(tmp_path))  # as a run
    assert torch.equal(network(images), trained(images))
    torch.nn.init.ones_(network.of_part)
    assert not torch.equal(network(images), trained(images))
    with pytest.raises(ValueError, match="expected a network of the same form"):
        start_from(network, str(tmp_path / "model"))  # whose parts have an effect


@pytest.mark.parametrize("stride", [1, 4])
def test_the_distances_of_a_part_of_a_map_are_those_to_the_robot(stride):
    whole, part = torch.zeros(1, 1, 32 // stride, 32 // stride), torch.zeros(1, 1, 24 // stride, 24 // stride)
    row, column = 8, 4
    expected = _distances(whole, stride, None)[..., row // stride :, column // stride : (column + 24) // stride]
    assert torch.allclose(_distances(part, stride, (16.0 - row, 16.0 - column)), expected, atol=1e-5)
