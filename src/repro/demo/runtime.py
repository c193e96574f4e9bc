"""ONNX Runtime Web for the page: the npm package at a pinned version, checked against its hash and cached."""

import base64
import hashlib
import logging
import os
import tarfile
import urllib.request
from dataclasses import dataclass
from http.client import HTTPException
from io import BytesIO
from pathlib import Path

from repro.system.errors import InputError
from repro.system.files import replacing

log = logging.getLogger(__name__)
VERSION = "1.30.0"
ARCHIVE = f"onnxruntime-web-{VERSION}.tgz"
URL = f"https://registry.npmjs.org/onnxruntime-web/-/{ARCHIVE}"
SHA512 = "q0y+JrrtukXSzsBWEMccVfqX25LRmosXHF+CaRJmg8pZClzcV7svNc4rKY3jL02Vb7QmRMDs1SigqR4CXAfKYQ=="  # of the registry
SCRIPT, WASM = "package/dist/ort.wasm.bundle.min.mjs", "package/dist/ort-wasm-simd-threaded.wasm"
TIMEOUT_S = 60
MOST_BYTES = 100_000_000  # the package has 33 MB


@dataclass(frozen=True)
class Runtime:
    """The two files of ONNX Runtime Web that the page needs: the JavaScript module and the compiled runtime."""

    script: str
    wasm: bytes


def load_runtime() -> Runtime:
    """Read ONNX Runtime Web from its npm package in the cache, where it is downloaded once.

    Raises:
        InputError: the package cannot be downloaded or read, or is another one than expected.
    """
    path = cached_archive()
    source = str(path) if path.is_file() else URL
    try:
        if source == URL:
            log.info("downloading %s (33 MB) to %s", URL, path)
        with urllib.request.urlopen(URL, timeout=TIMEOUT_S) if source == URL else path.open("rb") as file:
            content = file.read(MOST_BYTES)
    except (OSError, HTTPException) as error:
        raise InputError(
            f"{source} cannot be read ({error}): connect to the internet once, or download {URL} elsewhere to {path}"
        ) from error
    digest = base64.b64encode(hashlib.sha512(content).digest()).decode()
    if digest != SHA512:
        raise InputError(f"{source} has the hash sha512-{digest}, expected sha512-{SHA512} of {URL}")
    if source == URL:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            temporary.write_bytes(content)
    with tarfile.open(fileobj=BytesIO(content)) as package:
        script, wasm = (file.read() for name in (SCRIPT, WASM) if (file := package.extractfile(name)))
    return Runtime(script.decode(), wasm)


def cached_archive() -> Path:
    """Return where the npm package is cached, in the user's cache directory; the file may be missing."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "repro" / ARCHIVE
