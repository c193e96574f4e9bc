"""Predicting dynamic map states from limited field-of-view sensor data (Peterson and Han), reproduced.

The data takes one way, and imports follow it: simulation (a world to scans on disk), maps (scans to images),
learning, evaluation, reporting. `prediction` uses a trained network on anyone's scans. `run.py` maps a task to one
function of this package.
"""
