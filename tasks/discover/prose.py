"""What a methods section says of this task, with the numbers of a result."""

from sinew.tasks.discover.judge.confidence import in_words
from sinew.tasks.discover.quantities import quantity_words
from sinew.tasks.discover.result import DiscoverResult
from sinew.tasks.discover.show import in_one_sentence, of_the_law
from sinew.tasks.drawing.blocks import number, percent, plural


def methods(result: DiscoverResult) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
    best = result.candidates[0] if result.candidates else None
    first = "" if best is None else f" The best candidate, {best.name}, improves the criterion by {number(best.gain)}."
    sentence = in_one_sentence(result)
    part = f" {sentence}" if sentence else ""
    if result.explained is not None and not sentence:
        part = f" It explains {percent(result.explained)} of the misfit."
    if law := of_the_law(result):
        part += f" {law}"
    words = quantity_words(result)
    given = ", but for what is given" if "as given" in words else ""
    compared = f" Beside the force, the fits compare {words}." if words else ""
    return (
        f"To find out whether the model lacks an effect, it was fitted to {plural(len(result.noise), 'specimen')} with "
        f"and without each of {plural(len(result.candidates), 'candidate')} from a library of effects. The fits use "
        f"generalised least squares; the noise was estimated from the curves alone{given} [@patterson].{compared} "
        f"Verdict: {result.headline}: {result.why}.{first}{part} How far to trust it: {in_words(result.confidence)}."
    )
