"""Write model.onnx beside the weights of torch of a published network, as the library reads them.

    python -m reproduce.named [NAME or DIRECTORY ...]

Without arguments, it does so for all networks that have names in the package. A new name is a link in
src/repro/weights to the directory.
"""

import argparse

from repro.learning.networks.torch_files import CARD
from repro.learning.networks.trained import export_onnx, load_trained
from repro.networks.weights import NAMED_NETWORKS, ONNX, locate


def main() -> None:
    """Export the networks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "weights", nargs="*", default=NAMED_NETWORKS, help=f"{', '.join(NAMED_NETWORKS)}, or directories"
    )
    for weights in parser.parse_args().weights:
        directory = locate(weights)
        card = directory / CARD
        text = card.read_text(encoding="utf-8") if card.is_file() else ""
        difference = export_onnx(load_trained(weights), directory / ONNX, text)
        print(f"{directory / ONNX}: probabilities differ from those of torch by {difference:.1e} at most", flush=True)


if __name__ == "__main__":
    main()
