"""Reproduction of "Predicting dynamic map states from limited field-of-view sensor data" (Peterson and Han).

CONTRIBUTING.md lists the packages in the order of their dependencies.
"""
