import io
import tarfile
import urllib.error
from http.client import IncompleteRead

import pytest

from repro.demo import runtime


def test_a_missing_package_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"demo.runtime=.*gone.tgz cannot be read: No such file"):
        runtime.load_runtime(tmp_path / "gone.tgz")


def test_another_package_is_refused(tmp_path):
    path = tmp_path / "other.tgz"
    with tarfile.open(path, "w:gz") as package:
        package.addfile(tarfile.TarInfo(runtime.SCRIPT), io.BytesIO())
    with pytest.raises(ValueError, match=r"has the hash sha512-.*, expected sha512-q0y"):
        runtime.load_runtime(path)


@pytest.mark.parametrize(
    ("error", "reason"), [(urllib.error.URLError("no network"), "no network"), (IncompleteRead(b""), "IncompleteRead")]
)
def test_without_a_network_the_error_names_the_option_and_nothing_is_left(tmp_path, monkeypatch, error, reason):
    def refuse(*_, **__):
        raise error

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(runtime.urllib.request, "urlopen", refuse)
    with pytest.raises(ValueError, match=rf"cannot be downloaded .*{reason}.*demo.runtime="):
        runtime.load_runtime()
    assert not list(tmp_path.rglob("*.*"))


def test_a_damaged_download_is_not_cached(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(runtime.urllib.request, "urlopen", lambda *_, **__: io.BytesIO(b"<html>busy</html>"))
    with pytest.raises(ValueError, match=r"expected sha512-"):
        runtime.load_runtime()
    assert not runtime.cached_archive().exists()


def test_the_cached_package_has_both_files():
    if not runtime.cached_archive().is_file():
        pytest.skip(f"{runtime.cached_archive()} is missing: python run.py task=demo downloads it")
    loaded = runtime.load_runtime()
    assert loaded.wasm[:4] == b"\0asm"
    assert f"ONNX Runtime Web v{runtime.VERSION}" in loaded.script
