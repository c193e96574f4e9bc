"""Predicting dynamic map states from limited field-of-view sensor data (Peterson and Han), reproduced.

The data takes one way, and imports follow it: worlds, recording, store, projection, datasets, training,
evaluation, results, figures and report. `run.py` maps a task to one function of this package.
"""
