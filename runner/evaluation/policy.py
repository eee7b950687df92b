"""How rows are cut into batches, and how often failed rows are tried again."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Policy:
    """Settings of a run.

    ``batch_s``: intended duration of a batch (s); ``multiple``: batches hold a multiple of this many rows;
    ``retries``: how often a row with a status in :data:`sinew.runner.evaluation.batch.RETRIED` is tried again;
    ``batches_per_worker``: how many batches a worker may have, the running one included.
    """

    batch_s: float = 0.5
    multiple: int = 1
    retries: int = 1
    batches_per_worker: int = 2


DEFAULT_POLICY = Policy()
