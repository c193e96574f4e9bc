import copy

import pytest
import torch
from torch import nn

from repro.learning.kernels import DepthwiseConv2d, FloatGroupNorm, accelerate
from repro.learning.networks.create import create_network, load_network
from repro.learning.networks.smp_networks import FusedSegformerDecoder, LeanUnetBlock
from repro.runs.model import NETWORKS, paper_model


def gradients(network, image):
    network.zero_grad()
    torch.manual_seed(0)  # of dropout
    logits = network(image)
    logits.square().mean().backward()
    return logits, {name: parameter.grad for name, parameter in network.named_parameters()}


@pytest.mark.parametrize("architecture", NETWORKS)
def test_an_accelerated_network_has_the_same_outputs_gradients_and_weight_names(architecture):
    torch.manual_seed(1)
    plain, image = create_network(paper_model(architecture)).double(), torch.rand(2, 1, 64, 64, dtype=torch.double)
    fast = copy.deepcopy(plain)
    accelerate(fast, "cpu")
    assert list(fast.state_dict()) == list(plain.state_dict())
    (logits, found), (expected, slopes) = gradients(fast, image), gradients(plain, image)
    torch.testing.assert_close(logits, expected, rtol=1e-5, atol=1e-5)
    for name, slope in slopes.items():
        torch.testing.assert_close(found[name], slope, rtol=1e-4, atol=1e-6, msg=name)


def test_the_slow_modules_of_fpn_are_replaced_on_a_cpu_only():
    network = create_network(paper_model("fpn"))
    accelerate(network, "cuda")
    assert not any(isinstance(module, DepthwiseConv2d | FloatGroupNorm) for module in network.modules())
    accelerate(network, "cpu")
    kinds = [type(module) for module in network.modules()]
    assert (kinds.count(DepthwiseConv2d), kinds.count(FloatGroupNorm), kinds.count(nn.GroupNorm)) == (8, 7, 0)


def test_only_decoders_of_smp_are_replaced_and_their_saved_form_is_that_of_smp(tmp_path):
    expected = {"segformer": [FusedSegformerDecoder], "unet": 5 * [LeanUnetBlock]}
    for architecture in NETWORKS:
        network = create_network(paper_model(architecture))
        before = [type(module) for module in network.modules()]
        accelerate(network, "cuda")
        after = [type(module) for module in network.modules()]
        replaced = [new for old, new in zip(before, after, strict=True) if new is not old]
        assert replaced == expected.get(architecture, [])
        network.save_pretrained(tmp_path / architecture)
        loaded = load_network(tmp_path / architecture, "smp")
        assert [type(module) for module in loaded.modules()] == before
        images = torch.rand(2, 1, 96, 64)
        torch.testing.assert_close(network.eval()(images), loaded.eval()(images), rtol=1e-4, atol=1e-4)


def test_the_decoder_of_unet_stays_in_one_type_and_format():
    network = create_network(paper_model("unet"))
    accelerate(network, "cpu")
    decoded = []
    for block in network.decoder.blocks:
        block.conv1.register_forward_pre_hook(lambda _, images: decoded.append(images[0]))
    with torch.autocast("cpu", torch.bfloat16):
        network(torch.rand(2, 1, 64, 64))
    assert [images.dtype for images in decoded] == 5 * [torch.bfloat16]
    assert all(images.is_contiguous(memory_format=torch.channels_last) for images in decoded[1:])


@pytest.mark.parametrize("size", [(1, 1), (1, 5), (2, 2), (3, 2), (4, 4)])
def test_maps_of_any_size_are_convolved_as_by_the_plain_module(size):
    plain = nn.Conv2d(6, 6, 3, padding=1, groups=6).double()
    fast = copy.deepcopy(plain)
    accelerate(fast, "cpu")
    assert isinstance(fast, DepthwiseConv2d)
    images = torch.rand(2, 6, *size, dtype=torch.double)
    torch.testing.assert_close(fast(images), plain(images))


@pytest.mark.parametrize("other", [{"stride": 2}, {"dilation": 2}, {"padding": 0}, {"padding_mode": "reflect"}])
def test_other_convolutions_are_not_replaced(other):
    conv = nn.Conv2d(6, 6, 3, **{"padding": 1, "groups": 6, **other})
    accelerate(conv, "cpu")
    assert type(conv) is nn.Conv2d


def test_group_normalization_keeps_the_type_and_computes_in_float32():
    plain = nn.GroupNorm(2, 8)
    images = torch.randn(2, 8, 4, 4)
    expected = plain(images.bfloat16().float()).bfloat16()
    accelerate(plain, "cpu")
    assert isinstance(plain, FloatGroupNorm)
    with torch.autocast("cpu", torch.bfloat16):
        assert torch.equal(plain(images.bfloat16()), expected)
