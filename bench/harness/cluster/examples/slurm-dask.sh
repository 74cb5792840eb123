#!/bin/bash
# SLURM, one job: a Dask scheduler, a worker in each of the other tasks, and the run in the job's own shell.
#
#   fisheye-bench cluster-example slurm-dask > score.sh
#   DATASET=/shared/datasets/ours.yaml OUT=/shared/runs/ours sbatch --ntasks=33 score.sh
#
# A job that was cut off goes on where it stopped when it is submitted again.
# Data, OUT and the installed fisheye-bench[cluster] lie where every node sees them.
#SBATCH --job-name=fisheye-bench
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=2G
#SBATCH --time=04:00:00
#SBATCH --requeue
set -euo pipefail

: "${DATASET:?the card of the data set}" "${OUT:?the folder of the run}" "${METHOD:=spherical}" "${PROTOCOL:=paper-v1}"
: "${FISHEYE_BENCH_CACHE:=${TMPDIR:-/tmp}/fisheye-bench-cache-${USER:-$UID}}"

scheduler="$PWD/scheduler-$SLURM_JOB_ID.json"
trap 'kill $(jobs -p) 2> /dev/null || true; wait; rm -f "$scheduler"' EXIT

srun --ntasks=1 --exact dask scheduler --port 0 --no-dashboard --scheduler-file "$scheduler" &
for _ in $(seq 120); do [ -s "$scheduler" ] && break; sleep 0.5; done
srun --ntasks=$((SLURM_NTASKS - 1)) --exact dask worker --scheduler-file "$scheduler" --nworkers 1 --nthreads 1 \
    --no-dashboard --local-directory "${TMPDIR:-/tmp}" --death-timeout 60 &

fisheye-bench run "$DATASET" --method "$METHOD" --protocol "$PROTOCOL" --out "$OUT" --no-pictures \
    --scheduler "$scheduler" --cache "$FISHEYE_BENCH_CACHE"
