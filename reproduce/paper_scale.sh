#!/usr/bin/env bash
# Run the study at paper scale on a GPU machine that is available for a few minutes at a time. Each call takes at most
# MINUTES and resumes the previous one. The exit status is 0 when all runs are trained and evaluated, and 75 when the
# script must be called again.
#
#     reproduce/paper_scale.sh [overrides for run.py]
#
# Settings by environment variables:
#   MINUTES=9           limit of a call, without the set-up
#   SEEDS="0"           trained one after the other
#   KEEP=folder         storage that outlasts the machine: the outputs except recordings, checkpoints and the weights of
#                       evaluated runs are copied there at the end of each call and restored at the beginning
#   WHEELS=folder       wheels for a machine without network access, whose python3 has PyTorch and Lightning
#   COMMIT=hash         commit of code that was copied without its Git history, for the provenance
#   SCALE=paper LAUNCHER=one_gpu JOBS=3 WORKERS=<cores>
#
# Afterwards, on any machine: run.py task=analysis scale=paper, task=publish scale=paper.
set -euo pipefail
cd "$(dirname "$0")/.."

MINUTES=${MINUTES:-9} SCALE=${SCALE:-paper} OUTPUTS=outputs/${SCALE:-paper} CALL_AGAIN=75
TRAININGS=24 # four networks, four experiments with decay and two without
RESERVE=60 # [s] at the end of a call, to finish the current epoch and copy the outputs
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
    local evaluated # of a run that is not evaluated yet, the weights are kept, too
    mapfile -t evaluated < <(cd "$OUTPUTS" && find . -name metrics.csv -printf '--exclude=%h/model\n')
    mkdir -p "$KEEP"
    tar -C "$OUTPUTS" --exclude=./recordings --exclude=checkpoints "${evaluated[@]}" --exclude='*.tmp' -cf - . |
        tar -C "$KEEP" -xf -
}

restore() {
    [ -n "${KEEP:-}" ] && [ -d "$KEEP" ] && [ ! -d "$OUTPUTS" ] || return 0
    mkdir -p "$OUTPUTS"
    tar -C "$KEEP" -cf - . | tar -C "$OUTPUTS" -xf -
}

# Run run.py within the remaining time of the call; end the call if none is left
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
    echo "call again: stopped after $SECONDS s, not all runs are evaluated" >&2
    exit "$CALL_AGAIN"
}

set_up
restore
SECONDS=0
overrides=("$@")
trainings=("model=unet,fpn,upernet,segformer" "hydra/launcher=${LAUNCHER:-one_gpu}" "hydra.launcher.n_jobs=${JOBS:-3}")
step -m task=record exp=1,2,3,4 "runtime.workers=${WORKERS:-$(nproc)}" ${overrides[@]+"${overrides[@]}"}
for seed in ${SEEDS:-0}; do
    step -m "${trainings[@]}" exp=1,2,3,4 "seed=$seed" ${overrides[@]+"${overrides[@]}"}
    step -m "${trainings[@]}" exp=3,4 decay=false "seed=$seed" ${overrides[@]+"${overrides[@]}"}
    evaluated=$(find "$OUTPUTS/runs" -path "*/seed$seed/metrics.csv" | wc -l)
    echo "seed $seed: $evaluated of $TRAININGS trainings are evaluated"
    [ "$evaluated" -ge "$TRAININGS" ] || again
done
step task=report ${overrides[@]+"${overrides[@]}"}
keep
echo "done: the study at scale $SCALE is trained and evaluated, see $OUTPUTS/tables"
