"""A run without a cluster: batches one after the other, in this process."""

from sinew.runner.evaluation.batch import evaluations, run_batch
from sinew.runner.evaluation.run import Run, store_error


def work_in_process(run: Run) -> None:
    """Evaluate all rows of a run. Raises ``StoreError`` and ``WalltimeReached``."""
    evaluations.update({source.key: source.evaluation for source in run.sources})
    try:
        while run.left or run.sessions.open:
            run.sessions.listen(None, wait=not run.left)
            if not run.left:
                continue
            source, batch = run.next_batch(1, 0)
            if not run.in_time(batch):
                raise run.walltime_reached()
            try:
                run_batch(batch)
                run.note(source, batch)
                run.commit_many()
            except OSError as error:
                raise store_error(error, batch) from error
        run.commit()
    finally:
        for source in run.sources:
            del evaluations[source.key]
