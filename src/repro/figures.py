def write_figures(outputs, specs): return []
