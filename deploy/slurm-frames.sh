#!/bin/sh
# A sequence as a Slurm array: each job of the array renders a range of frames, as an MPI job of its own. Jobs that failed or
# were preempted restart and keep existing images.
#     sbatch --array=0-9 slurm-frames.sh 0 2399 --source 'captures/sky.%04d.exr' --out 'pictures/%04d.exr'
# The numbers are the first and the last frame; the other arguments are those of relight-render. docs/clusters.md describes the choice
# of tasks and processors.
#SBATCH --job-name=relight-frames
#SBATCH --ntasks=4
#SBATCH --cpus-per-task=2
#SBATCH --requeue
#SBATCH --open-mode=append
set -eu

if [ $# -lt 2 ] || [ -z "${SLURM_ARRAY_TASK_ID:-}" ]; then
    echo "usage: sbatch --array=0-N slurm-frames.sh FIRST LAST relight-render's arguments..." >&2
    exit 2
fi
first=$1 last=$2
shift 2
# shellcheck disable=SC2153 # Slurm sets all three
count=$((SLURM_ARRAY_TASK_MAX - SLURM_ARRAY_TASK_MIN + 1))
index=$((SLURM_ARRAY_TASK_ID - SLURM_ARRAY_TASK_MIN))
frames=$((last - first + 1))
begin=$((first + frames * index / count))
end=$((first + frames * (index + 1) / count - 1))
[ "$end" -ge "$begin" ] || exit 0 # more jobs than frames

exec srun --mpi=pmix --kill-on-bad-exit=1 --cpus-per-task="${SLURM_CPUS_PER_TASK:-1}" \
    "${RELIGHT_RENDER:-relight-render}" --threads "${SLURM_CPUS_PER_TASK:-1}" --frames "$begin-$end" --resume "$@"
