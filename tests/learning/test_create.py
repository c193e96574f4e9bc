import json

import pytest
import segmentation_models_pytorch as smp
import torch
from huggingface_hub import PyTorchModelHubMixin

from repro.learning.networks.create import OWN_ARCHITECTURES, check_interface, create_network, load_network
from repro.runs.model import NETWORKS, Model, paper_model

MILLIONS = {"unet": 5.55, "fpn": 5.07, "upernet": 10.73, "segformer": 3.71}


@pytest.mark.parametrize("architecture", NETWORKS)
def test_one_gray_image_is_mapped_to_one_map_of_logits(architecture):
    model = create_network(paper_model(architecture)).eval()
    check_interface(model, 1)
    check_interface(create_network(paper_model(architecture), in_channels=4), 4)
    assert sum(p.numel() for p in model.parameters()) / 1e6 == pytest.approx(MILLIONS[architecture], abs=0.01)


@pytest.mark.parametrize(
    ("output", "got"),
    [
        (lambda x: torch.cat([x, x], dim=1), r"\(2, 2, 64, 64\)"),
        (lambda x: x[:, 0], r"\(2, 64, 64\)"),
        (lambda x: x[..., ::2, ::2], r"\(2, 1, 32, 32\)"),
        (lambda x: [x], "list"),
    ],
)
def test_another_output_than_one_map_is_refused(output, got):
    class Own(torch.nn.Module, PyTorchModelHubMixin):
        def forward(self, images):
            return output(images[:, :1])

    expected = r"images \(B, 3, H, W\) to logits \(B, 1, H, W\): expected \(2, 1, 64, 64\) of \(2, 3, 64, 64\), got "
    with pytest.raises(ValueError, match=expected + got):
        check_interface(Own(), 3)


def test_a_network_is_checked_at_the_size_of_its_maps():
    class Embedded(torch.nn.Module, PyTorchModelHubMixin):
        def __init__(self):
            super().__init__()
            self.position = torch.nn.Parameter(torch.zeros(1, 1, 128, 128))

        def forward(self, images):
            return images + self.position

    check_interface(Embedded(), 1, 128)


def test_a_network_that_cannot_be_saved_is_refused():
    with pytest.raises(ValueError, match="Conv2d must save itself: make it a subclass of PyTorchModelHubMixin"):
        check_interface(torch.nn.Conv2d(1, 1, 1), 1)


def test_unknown_architecture_lists_the_known_ones():
    with pytest.raises(ValueError, match=r"model\.architecture=resnet: must be one of") as caught:
        create_network(paper_model("resnet"))
    assert all(name in str(caught.value) for name in (*NETWORKS, *OWN_ARCHITECTURES))


def test_a_network_that_began_with_pretrained_weights_is_loaded_without_them(tmp_path, monkeypatch):
    """Its config.json names them; the weights of the training replace them, so nothing is downloaded."""
    saved = create_network(paper_model("segformer"))
    saved.save_pretrained(tmp_path)
    config = json.loads((tmp_path / "config.json").read_text())
    (tmp_path / "config.json").write_text(json.dumps({**config, "encoder_weights": "imagenet"}))
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    loaded = load_network(tmp_path, "smp").state_dict()
    assert all(torch.equal(weights, loaded[name]) for name, weights in saved.state_dict().items())


def test_encoder_weights_that_cannot_be_loaded_are_reported_with_a_fix(monkeypatch):
    def refuse(*_, **__):
        raise OSError("offline")

    monkeypatch.setattr(smp, "create_model", refuse)
    with pytest.raises(ValueError, match=r"imagenet weights of mit_b0 .*offline.*encoder_weights=null"):
        create_network(Model("unet", encoder_name="mit_b0", encoder_weights="imagenet"))


@pytest.mark.parametrize("name", ["tu-hf_hub:someone/network", "tu-hf-hub:someone/network", "tu-local-dir:/tmp", None])
def test_an_encoder_from_elsewhere_is_refused(tmp_path, name, monkeypatch):
    create_network(paper_model("fpn")).save_pretrained(tmp_path)
    config = json.loads((tmp_path / "config.json").read_text())
    (tmp_path / "config.json").write_text(json.dumps({**config, "encoder_name": name}))
    monkeypatch.setattr(smp, "from_pretrained", lambda *_, **__: pytest.fail("it is loaded"))
    with pytest.raises(ValueError, match="encoder_name"):
        load_network(tmp_path, "smp")
