import io
import tarfile
import urllib.error

import pytest

from repro.demo import runtime


def test_a_missing_or_another_package_is_refused(tmp_path):
    path = tmp_path / "other.tgz"
    with pytest.raises(ValueError, match=r"other.tgz cannot be read .*No such file.*demo.runtime="):
        runtime.load_runtime(path)
    with tarfile.open(path, "w:gz") as package:
        package.addfile(tarfile.TarInfo(runtime.SCRIPT), io.BytesIO())
    with pytest.raises(ValueError, match=r"other.tgz has the hash sha512-.*, expected sha512-q0y"):
        runtime.load_runtime(path)


def test_a_failed_download_is_named_and_leaves_nothing(tmp_path, monkeypatch):
    def respond(*_, **__):
        raise urllib.error.URLError("no network")

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(runtime.urllib.request, "urlopen", respond)
    with pytest.raises(ValueError, match=r"cannot be read .*no network.*demo.runtime="):
        runtime.load_runtime()
    assert not list(tmp_path.rglob("*.*"))


def test_the_cached_package_has_both_files():
    if not runtime.cached_archive().is_file():
        pytest.skip(f"{runtime.cached_archive()} is missing: python run.py task=demo downloads it")
    loaded = runtime.load_runtime()
    assert loaded.wasm[:4] == b"\0asm"
    assert f"ONNX Runtime Web v{runtime.VERSION}" in loaded.script
