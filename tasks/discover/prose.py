"""What a methods section says of this task, with the numbers of a result."""

from sinew.tasks.discover.judge.confidence import in_words
from sinew.tasks.discover.result import DiscoverResult
from sinew.tasks.drawing.blocks import number, percent, plural


def methods(result: DiscoverResult) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
    best = result.candidates[0] if result.candidates else None
    first = "" if best is None else f" The best candidate, {best.name}, improves the criterion by {number(best.gain)}."
    part = "" if result.explained is None else f" It explains {percent(result.explained)} of the misfit."
    return (
        f"Whether model and measurements disagree was asked by comparing the model with and without "
        f"{plural(len(result.candidates), 'candidate')} from a library of effects, fitted to "
        f"{plural(len(result.noise), 'specimen')} by generalised least squares with noise that was estimated from the "
        f"curves alone [@patterson]. Verdict: {result.headline}: {result.why}.{first}{part} Of this word, "
        f"{in_words(result.confidence)}."
    )
