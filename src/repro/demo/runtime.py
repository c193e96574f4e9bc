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
    """The two files of ONNX Runtime Web that the page needs.

    Args:
        script: source of the JavaScript module.
        wasm: the compiled runtime.
    """

    script: str
    wasm: bytes


def load_runtime(archive: Path | None = None) -> Runtime:
    """Read ONNX Runtime Web from its npm package.

    Args:
        archive: the npm package; None takes it from the cache, or downloads it.

    Raises:
        ValueError: the package cannot be downloaded or read, or is another one than expected.
    """
    path = archive or cached_archive()
    if archive is None and not path.is_file():
        content = _checked(_download(), URL)
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            temporary.write_bytes(content)
    else:
        content = _checked(_read(path), f"{path}, which should be {URL},")
    with tarfile.open(fileobj=BytesIO(content)) as package:
        script, wasm = (_member(package, name) for name in (SCRIPT, WASM))
    return Runtime(script.decode(), wasm)


def cached_archive() -> Path:
    """Return where the npm package is cached, in the user's cache directory; the file may be missing."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "repro" / ARCHIVE


def _download() -> bytes:
    log.info("downloading %s (33 MB) to %s", URL, cached_archive())
    try:
        with urllib.request.urlopen(URL, timeout=TIMEOUT_S) as response:
            return response.read()
    except (OSError, HTTPException) as error:
        raise InputError(
            f"{URL} cannot be downloaded ({error}): connect to the internet once, or download the file elsewhere and "
            "name it with demo.runtime="
        ) from error


def _read(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(MOST_BYTES)
    except OSError as error:
        raise InputError(f"demo.runtime={path} cannot be read: {error.strerror}; expected {ARCHIVE}") from error


def _checked(content: bytes, source: str) -> bytes:
    digest = base64.b64encode(hashlib.sha512(content).digest()).decode()
    if digest != SHA512:
        raise InputError(f"{source} has the hash sha512-{digest}, expected sha512-{SHA512}")
    return content


def _member(package: tarfile.TarFile, name: str) -> bytes:
    file = package.extractfile(name)
    assert file, f"{name} is a file of the package, whose hash is checked"
    return file.read()
