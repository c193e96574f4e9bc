"""A `python` that starts with the large libraries imported: a process imports them once and forks for each program."""

import atexit
import gc
import importlib
import json
import os
import runpy
import select
import socket
import subprocess
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LIBRARIES = (  # that many programs import, and that import no module of this project
    *("hydra", "irsim", "lightning", "matplotlib.pyplot", "numba", "onnx", "onnxruntime", "pandas", "piqa", "pydantic"),
    *("segmentation_models_pytorch", "sklearn.metrics"),
)
PROGRAM = f"#!{sys.executable} -SE\nimport sys\nsys.path.insert(0, {str(Path(__file__).parent)!r})\n"


@contextmanager
def preloaded_python(directory: Path) -> Iterator[Path]:
    """Write the file `python` into a directory; in the context, it runs programs as Python does."""
    python, address = directory / "python", str(directory / "socket")
    python.write_text(f"{PROGRAM}import preloaded\nsys.exit(preloaded.hand_over({address!r}))\n")
    python.chmod(0o755)
    unwanted = ("PYTHONPATH", "DISPLAY", "WAYLAND_DISPLAY")
    environment = {name: value for name, value in os.environ.items() if name not in unwanted}
    with socket.socket(socket.AF_UNIX) as calls:
        calls.bind(address)
        calls.listen()
        command, streams = [sys.executable, "-P", __file__], {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL}
        command.append(str(calls.fileno()))
        server = subprocess.Popen(command, env=environment, pass_fds=[calls.fileno()], **streams)
    with server:
        yield python
        server.communicate()


def hand_over(address: str) -> int:
    """Hand this call of Python to the process of the libraries; return the status with which its program ends."""
    with socket.socket(socket.AF_UNIX) as server:
        server.connect(address)
        call = json.dumps([sys.argv[1:], os.getcwd(), dict(os.environ)])
        socket.send_fds(server, [call.encode()], (0, 1, 2))
        return int(server.recv(9) or 137)  # of a program that was killed


def serve(calls: socket.socket) -> socket.socket:
    """Import the libraries, then fork for every call until the standard input ends; return the call in the fork."""
    for name in LIBRARIES:
        importlib.import_module(name)
    gc.freeze()  # collections in a fork would copy the memory of the libraries
    while sys.stdin not in select.select([calls, sys.stdin], [], [])[0]:
        call, _ = calls.accept()
        if os.fork() == 0:
            return call
        call.close()
    os._exit(0)


def run_program(call: socket.socket) -> None:
    """Run the program of a call in this process, send the status with which it ends, and end."""
    content, streams, *_ = socket.recv_fds(call, 2**20, 3)
    sys.argv, directory, environment = json.loads(content)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
    sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", 1, closefd=False)
    os.chdir(directory)
    os.environ.clear()
    os.environ.update(environment)
    first = "" if sys.argv[0] == "-c" else str(Path(sys.argv[0]).absolute().parent)
    sys.path[:0] = [first, *filter(None, environment.get("PYTHONPATH", "").split(os.pathsep))]
    status: object = 0
    try:
        if sys.argv[0] == "-c":
            exec(sys.argv.pop(1), {"__name__": "__main__"})
        else:
            runpy.run_path(sys.argv[0], run_name="__main__")
    except BaseException as error:
        status = (error.code or 0) if isinstance(error, SystemExit) else traceback.format_exc()
    threading._shutdown()
    atexit._run_exitfuncs()
    print(status if isinstance(status, str) else "", end="", file=sys.stderr, flush=True)
    sys.stdout.flush()
    call.send(str(status if isinstance(status, int) else 1).encode())
    os._exit(0)  # Python would first free the libraries, which takes seconds


if __name__ == "__main__":
    run_program(serve(socket.socket(fileno=int(sys.argv[1]))))
