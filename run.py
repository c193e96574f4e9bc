"""The entry point from a checkout; `repro.cli` composes the configuration by Hydra, checks it and runs a task.

python run.py exp=3 model=unet                                         record what is missing, train, evaluate
python run.py -m model=unet,fpn,upernet,segformer exp=3,4 decay=false  a sweep, then its table
python run.py task=record exp=3                                        simulate and store one experiment
python run.py task=report                                              tables and figures from the runs that are there
python run.py task=world exp=3 seed=17                                 write one world and its twin as IR-SIM YAML
python run.py --help                                                   all tasks, groups and keys
"""

import sys

from repro.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
