"""Reproduction of "Predicting dynamic map states from limited field-of-view sensor data" (Peterson and Han).

The packages in order; each imports only from those before it, except for types:

    system       atomic files, locks and checksums; device, precision and hardware
    config       the typed configuration
    metrics      scores, calibration and bootstrap: arrays in, numbers out
    scans        the lidar scan type that all packages share
    runs         run directories, their identity and provenance
    recordings   shards and manifests on disk; independent of IR-SIM
    simulation   from a world to recordings
    maps         grid, encodings of scans, true maps, visibility, training pairs
    prediction   logs and live scans of other robots, and maps as files
    networks     architectures, and predictors that apply a trained network to any scans
    learning     training, losses, checkpoints
    baselines    classical methods for the same task
    evaluation   metrics of trained networks, and the analyses beyond the paper
    reporting    tables, figures, claims and the results page
    demo         the browser demo: networks and ONNX Runtime Web in one HTML file
    cli          validation of the configuration, and one module per task of `run.py`
"""
