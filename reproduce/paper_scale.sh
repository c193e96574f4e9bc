#!/usr/bin/env bash
# The study at paper scale on a machine with a GPU that is lent for minutes: each call takes at most MINUTES, goes on
# where the last one stopped, and ends with 0 when all is trained and evaluated, with 75 when it is to be called again.
#
#     reproduce/paper_scale.sh [words for run.py]
#
# All by environment variables:
#   MINUTES=9           of a call, set-up apart
#   SEEDS="0"           one after the other
#   KEEP=folder         what must outlast the machine is copied there at the end of a call, and from there at the
#                       beginning of one: everything but recordings, checkpoints and weights
#   WHEELS=folder       wheels, for a machine without network source python3 has PyTorch and Lightning
#   COMMIT=hash         of the code, where it was copied without its git history; stands in the provenance
#   SCALE=paper LAUNCHER=one_gpu JOBS=3 WORKERS=<cores>
#
# Then, at leisure and on any machine: run.py task=analysis scale=paper, task=publish scale=paper.
set -euo pipefail
cd "$(dirname "$0")/.."

MINUTES=${MINUTES:-9} SCALE=${SCALE:-paper} OUTPUTS=outputs/${SCALE:-paper} CALL_AGAIN=75
RESERVE=60 # seconds at the end of a call, for the epoch that is under way and the copying
export PYTHONPATH=$PWD/src REPRO_COMMIT=${COMMIT:-}

set_up() {
    if [ -n "${WHEELS:-}" ] && [ ! -e .venv/ready ]; then
        python3 -m venv --clear --system-site-packages .venv
        .venv/bin/pip install --quiet --no-index --no-deps "$WHEELS"/*.whl
        touch .venv/ready
    elif [ ! -e .venv/ready ]; then
        make setup
    fi
}

keep() {
    [ -n "${KEEP:-}" ] && [ -d "$OUTPUTS" ] || return 0
    mkdir -p "$KEEP"
    tar -C "$OUTPUTS" --exclude=./recordings --exclude=checkpoints --exclude=model --exclude='*.tmp' -cf - . | tar -C "$KEEP" -xf -
}

restore() {
    [ -n "${KEEP:-}" ] && [ -d "$KEEP" ] && [ ! -d "$OUTPUTS" ] || return 0
    mkdir -p "$OUTPUTS"
    tar -C "$KEEP" -cf - . | tar -C "$OUTPUTS" -xf -
}

# run.py with what is left of the call; ends the call where that is used up
step() {
    local left=$((60 * MINUTES - SECONDS)) status=0
    [ "$left" -gt "$RESERVE" ] || again
    local budget
    budget=$(awk -v left="$left" -v reserve="$RESERVE" 'BEGIN { print (left - reserve) / 60 }')
    timeout --foreground --signal=INT --kill-after=20 "$left" .venv/bin/python run.py "$@" "scale=$SCALE" "runtime.max_minutes=$budget" ||
        status=$?
    case $status in
        0) ;;
        124 | 130 | 137) again ;;
        *) keep && exit "$status" ;;
    esac
}

again() {
    keep
    echo "to be called again: $SECONDS s of this call are over" >&2
    exit "$CALL_AGAIN"
}

set_up
restore
SECONDS=0
words=("$@")
trainings=("model=unet,fpn,upernet,segformer" "hydra/launcher=${LAUNCHER:-one_gpu}" "hydra.launcher.n_jobs=${JOBS:-3}")
step -m task=record exp=1,2,3,4 "runtime.workers=${WORKERS:-$(nproc)}" ${words[@]+"${words[@]}"}
for seed in ${SEEDS:-0}; do
    step -m "${trainings[@]}" exp=1,2,3,4 "seed=$seed" ${words[@]+"${words[@]}"}
    step -m "${trainings[@]}" exp=3,4 decay=false "seed=$seed" ${words[@]+"${words[@]}"}
    status=$(step task=status "seed=$seed" ${words[@]+"${words[@]}"})
    echo "$status"
    [[ $status == *": 24 evaluated."* ]] || again
done
step task=report ${words[@]+"${words[@]}"}
keep
echo "done: the study at scale $SCALE is trained and evaluated, see $OUTPUTS/tables"
