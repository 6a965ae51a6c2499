#!/bin/sh
# A job array of Slurm: 8 tasks share a folder of structures. `sbatch job_array.sh`; again, after tasks were killed, and
# only what is missing is done. Each task adds to its own results-I-of-8.jsonl.
#SBATCH --array=1-8
#SBATCH --cpus-per-task=4
#SBATCH --mem=8G
exec 00_pipeline structures/ --out out --no-pictures --quiet \
    --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" \
    --threads "$SLURM_CPUS_PER_TASK" --max-memory 6G
