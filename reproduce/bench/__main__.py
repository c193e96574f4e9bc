"""Benchmark speed and memory against straightforward implementations, all in the same run on this machine.

make bench        or        python reproduce/bench [recording projection streaming training navigation]
"""

import argparse
import warnings

from navigation import bench_navigation
from projection import bench_projection
from recording import bench_recording
from streaming import bench_streaming
from training import bench_training

PARTS = {  # with the time that each takes on 2 idle cores
    "recording": (bench_recording, "1 minute"),
    "projection": (bench_projection, "half a minute"),
    "streaming": (bench_streaming, "2 minutes"),
    "training": (bench_training, "8 minutes"),
    "navigation": (bench_navigation, "3 minutes"),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", help=f"{', '.join(PARTS)}; default: all")
    options = parser.parse_args()
    unknown = set(options.parts) - set(PARTS)
    if unknown:
        parser.error(f"parts must be among {', '.join(PARTS)}, got {', '.join(sorted(unknown))}")
    warnings.simplefilter("ignore")
    for name in options.parts or PARTS:
        bench, takes = PARTS[name]
        print(f"\n{name}: takes about {takes} on 2 idle cores", flush=True)
        bench()


if __name__ == "__main__":
    main()
