#!/bin/sh
# relightd as a Slurm job: rank 0 serves the viewers, all ranks light each image. If a rank dies, the job ends and restarts from
# the stored cache; viewers reconnect by themselves.
#     sbatch slurm-live.sh --scene court.json --size 1280x720 --cache-dir /shared/relight
# The arguments are those of relightd. The page is at the first node of the job: squeue -j JOB -o %B.
#SBATCH --job-name=relightd
#SBATCH --ntasks=4
#SBATCH --cpus-per-task=2
#SBATCH --time=24:00:00
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --signal=B:TERM@30
set -eu

server=
stopped=
stop() {
    stopped=1
    [ -z "$server" ] || kill -TERM "$server" 2>/dev/null || true
}
trap stop TERM INT

while [ -z "$stopped" ]; do
    status=0
    srun --mpi=pmix --kill-on-bad-exit=1 --cpus-per-task="${SLURM_CPUS_PER_TASK:-1}" \
        "${RELIGHTD:-relightd}" --threads "${SLURM_CPUS_PER_TASK:-1}" "$@" &
    server=$!
    wait "$server" || status=$?
    [ -z "$stopped" ] || wait "$server" || status=$?
    # 0: it was told to end; 2: its flags are wrong, and would be again.
    [ "$status" -ne 0 ] && [ "$status" -ne 2 ] && [ -z "$stopped" ] || exit "$status"
    echo "relightd ended with status $status and starts again" >&2
    sleep 1
done
