import pytest
import segmentation_models_pytorch as smp
import torch

from repro.learning import models
from repro.learning.models import ARCHITECTURES, compiles, create_model, resolve_precision

MILLIONS = {"unet": 5.55, "fpn": 5.07, "upernet": 10.73, "segformer": 3.71}


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_maps_one_gray_image_to_one_map_of_logits(architecture):
    model = create_model(architecture).eval()
    with torch.inference_mode():
        assert model(torch.rand(2, 1, 64, 64)).shape == (2, 1, 64, 64)
    assert sum(p.numel() for p in model.parameters()) / 1e6 == pytest.approx(MILLIONS[architecture], abs=0.01)


def test_weights_survive_saving_and_loading(tmp_path):
    model = create_model("fpn").eval()
    model.save_pretrained(tmp_path)
    again, image = smp.from_pretrained(tmp_path).eval(), torch.rand(1, 1, 64, 64)
    with torch.inference_mode():
        assert torch.equal(model(image), again(image))


def test_unknown_architecture_lists_the_known_ones():
    with pytest.raises(ValueError, match=r"unet, fpn, upernet, segformer, got 'resnet'"):
        create_model("resnet")


def test_weights_that_cannot_be_had_say_what_to_do(monkeypatch):
    def refuse(*_, **__):
        raise OSError("offline")

    monkeypatch.setattr(smp, "create_model", refuse)
    with pytest.raises(ValueError, match=r"imagenet weights of mit_b0 .*offline.*encoder_weights=null"):
        create_model("unet", encoder_weights="imagenet")


def test_where_compiling_fails_it_says_so_and_is_left_out(monkeypatch, capsys):
    def fail(self, *_, **__):
        self.forward = None  # the compiler's failure shows at the first call

    monkeypatch.setattr(torch.nn.Module, "compile", fail)
    assert not compiles("fpn", "mit_b0", 32, "cpu")
    assert "torch.compile fails here (TypeError)" in capsys.readouterr().out
    monkeypatch.setattr(torch.nn.Module, "compile", lambda self: None)
    assert compiles("fpn", "mit_b0", 64, "cpu")


@pytest.mark.parametrize(("native", "auto"), [(True, "bf16-mixed"), (False, "32-true")])
def test_precision_follows_the_device_only_when_it_is_auto(native, auto, monkeypatch):
    monkeypatch.setattr(models, "_cpu_has_bf16", lambda: native)
    assert resolve_precision("auto", "cpu") == auto
    assert resolve_precision("bf16-mixed", "cpu") == "bf16-mixed"
    assert resolve_precision("32-true", "cpu") == "32-true"
