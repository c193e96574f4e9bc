"""Print the median time and processor time of an update of a stream [s], and the time per processor time of a thread.

python update_times.py <log of scans, npz>
"""

import sys
import time

import numpy as np

import repro

ROUNDS = 12  # updates of the stream

log = np.load(sys.argv[1])
stream = repro.PredictionStream(repro.load_predictor("rooms"), log["angles"], center="robot", range_max_m=30)
updates, stretched = [], []
for ranges, pose, stamp in zip(log["ranges"], log["poses"], log["stamps"], strict=True):
    begin, cpu = time.perf_counter(), time.process_time()
    if stream.update(ranges, pose, stamp) is None:
        continue
    updates.append((time.perf_counter() - begin, time.process_time() - cpu))
    begin, cpu = time.perf_counter(), time.process_time()
    sum(range(2_000_000))  # on one thread
    stretched.append((time.perf_counter() - begin) / (time.process_time() - cpu))
    if len(updates) > ROUNDS:
        break
print(*np.median(updates[1:], axis=0), np.median(stretched))  # the first update compiles
