"""How rows are cut into batches, how often failed rows are tried again, and how often rows reach the disk."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Policy:
    """Settings of a run.

    ``batch_s``: intended duration of a batch (s); ``multiple``: batches hold a multiple of this many rows;
    ``retries``: how often a row with a status in :data:`sinew.runner.evaluation.batch.RETRIED` is tried again;
    ``batches_per_worker``: how many batches a worker may have, the running one included;
    ``sync_s``: rows that have been finished for longer (s) survive a loss of power.
    """

    batch_s: float = 0.5
    multiple: int = 1
    retries: int = 1
    batches_per_worker: int = 2
    sync_s: float = 5.0


DEFAULT_POLICY = Policy()
