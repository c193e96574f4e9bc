import urllib.error

import pytest

from repro.demo import runtime


def test_another_package_and_a_failed_download_are_refused(tmp_path, monkeypatch):
    def respond(*_, **__):
        raise urllib.error.URLError("no network")

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(runtime.urllib.request, "urlopen", respond)
    with pytest.raises(ValueError, match=r"cannot be read .*no network.*elsewhere to .*\.tgz"):
        runtime.load_runtime()
    assert not list(tmp_path.rglob("*.*"))
    runtime.cached_archive().write_bytes(b"another")
    with pytest.raises(ValueError, match=r"tgz has the SHA-256 .*, expected d2228df7"):
        runtime.load_runtime()


def test_the_cached_package_has_both_files():
    if not runtime.cached_archive().is_file():
        pytest.skip(f"{runtime.cached_archive()} is missing: python run.py task=demo downloads it")
    loaded = runtime.load_runtime()
    assert loaded.wasm[:4] == b"\0asm"
    assert f"ONNX Runtime Web v{runtime.VERSION}" in loaded.script
