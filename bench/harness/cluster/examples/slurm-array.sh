#!/bin/bash
# SLURM without any scheduler of our own: each task of a job array scores one part of the units.
#
#   fisheye-bench cluster-example slurm-array > score.sh
#   export DATASET=/shared/datasets/ours.yaml METHOD=spherical OUT=/shared/runs/ours
#   job=$(sbatch --parsable --array=1-32 score.sh)
#   sbatch --dependency=afterany:$job score.sh      # without --array: computes what is missing and ends the run
#
# A task that died is repeated with `sbatch --array=7 --export=ALL,PARTS=32 score.sh`; what it had stored is kept.
# Data, OUT and the installed fisheye-bench lie where every node sees them; rendered data sets are rendered before.
#SBATCH --job-name=fisheye-bench
#SBATCH --cpus-per-task=1
#SBATCH --mem=2G
#SBATCH --time=04:00:00
#SBATCH --requeue
set -euo pipefail

: "${DATASET:?the card of the data set}" "${OUT:?the folder of the run}" "${METHOD:=spherical}" "${PROTOCOL:=paper-v1}"
: "${PARTS:=${SLURM_ARRAY_TASK_COUNT:-1}}" "${FISHEYE_BENCH_CACHE:=${TMPDIR:-/tmp}/fisheye-bench-cache-${USER:-$UID}}"

exec fisheye-bench run "$DATASET" --method "$METHOD" --protocol "$PROTOCOL" --out "$OUT" \
    ${SLURM_ARRAY_TASK_ID:+--shard "$SLURM_ARRAY_TASK_ID/$PARTS"} --workers 1 --cache "$FISHEYE_BENCH_CACHE" --no-pictures
