"""Scans with poses become windows and maps: of a log, of a stream; their agreement, figures and files."""
