"""Families of worlds: their statistics, small trainings in them, and how far studies are from the paper's tables."""
