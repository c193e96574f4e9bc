"""ONNX Runtime Web for the page: the npm package at a pinned version, checked against its hash and cached."""

import logging
import os
import tarfile
import urllib.request
from dataclasses import dataclass
from http.client import HTTPException
from pathlib import Path

from repro.system.errors import InputError
from repro.system.files import replacing, sha256

log = logging.getLogger(__name__)
VERSION = "1.30.0"
ARCHIVE = f"onnxruntime-web-{VERSION}.tgz"
URL = f"https://registry.npmjs.org/onnxruntime-web/-/{ARCHIVE}"
SHA256 = "d2228df7e4616bc3348bf504ee888f3bec43789a273f0a63f3e68d203ce3bf71"
SCRIPT, WASM = "package/dist/ort.wasm.bundle.min.mjs", "package/dist/ort-wasm-simd-threaded.wasm"


@dataclass(frozen=True)
class WebRuntime:
    """The two files of ONNX Runtime Web that the page needs: the JavaScript module and the compiled runtime."""

    script: str
    wasm: bytes


def load_runtime() -> WebRuntime:
    """Read ONNX Runtime Web from its npm package in the cache, where it is downloaded once.

    Raises:
        InputError: the package cannot be downloaded, or is another one than expected.
    """
    path = cached_archive()
    if not path.is_file():
        log.info("downloading %s (33 MB) to %s", URL, path)
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with urllib.request.urlopen(URL, timeout=60) as response, replacing(path) as new:
                new.write_bytes(response.read())
        except (OSError, HTTPException) as error:
            advice = f"connect to the internet once, or download it elsewhere to {path}"
            raise InputError(f"{URL} cannot be read ({error}): {advice}") from error
    if (found := sha256(path)) != SHA256:
        raise InputError(f"{path} has the SHA-256 {found}, expected {SHA256} of {URL}: delete it")
    with tarfile.open(path) as package:
        script, wasm = (file.read() for name in (SCRIPT, WASM) if (file := package.extractfile(name)))
    return WebRuntime(script.decode(), wasm)


def cached_archive() -> Path:
    """Return where the npm package is cached, in the user's cache directory; the file may be missing."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "repro" / ARCHIVE
