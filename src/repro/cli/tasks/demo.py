"""task=demo: one HTML file that runs networks in the browser."""

from repro.cli.jobs import Job
from repro.cli.tasks import NETWORK_KEYS, Task


def run(job: Job) -> None:
    """Write the page.

    Raises:
        InputError: a network or the runtime cannot be used.
    """
    print("loading ONNX Runtime Web and the networks", flush=True)
    from repro.cli.log_prediction import load
    from repro.demo.demo_page import render
    from repro.demo.networks import demo_network
    from repro.demo.runtime import load_runtime
    from repro.system.files import write_text

    runtime = load_runtime()
    networks = []
    for number, name in enumerate(job.call.demo.networks, start=1):
        print(f"network {number} of {len(job.call.demo.networks)}: {name}", flush=True)
        networks.append(demo_network(name, load(name)))
    page = render(networks, runtime)
    path = job.outputs.path / "demo.html"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, page)
    print(f"{path} ({len(page) / 1e6:.1f} MB)")


TASK = Task(
    run,
    once=True,
    names_scale=False,
    own=("demo",),
    ignores=("world", "exp", *NETWORK_KEYS, "recordings", "runtime"),
    instead="demo.networks chooses the network",
)
