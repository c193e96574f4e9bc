"""Logs and messages of other robots become scans with poses and times: formats, poses, clocks, checks of scans."""
