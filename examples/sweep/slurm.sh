#!/bin/bash
# A sweep as a Slurm array, one shard a task:
#
#   sbatch slurm.sh gains.toml
#   sbatch --dependency=afterok:JOB --wrap 'armplane sweep --merge shards/* --out gains'
#
# A task that is preempted or dies is queued again and goes on in its folder: no run is lost, none is computed twice.
#SBATCH --array=1-16
#SBATCH --cpus-per-task=4
#SBATCH --requeue
#SBATCH --open-mode=append
set -eu
exec armplane sweep "$1" --shard "$SLURM_ARRAY_TASK_ID/16" --out "shards/$SLURM_ARRAY_TASK_ID"
