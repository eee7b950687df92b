"""What a study leaves open is filled in by the method and its mode."""

import pytest
from pydantic import ValidationError

from sinew.tasks.infer.settings import Settings


def test_the_papers_mode_is_for_simulators_that_take_time():
    paper = Settings(method="abc").by_abc(quick=False)
    assert (paper.paper, paper.population, paper.epsilon, paper.priors, paper.ess) == (True, 40, 0.3, None, None)
    sound = Settings(method="abc").by_abc(quick=True)
    assert (sound.paper, sound.population, sound.epsilon, sound.priors, sound.ess) == (False, 1000, None, "ranges", 400)


def test_what_is_asked_for_stays():
    found = Settings(paper=True, population=12, generations=3).by_abc(quick=True)
    assert (found.paper, found.population, found.generations) == (True, 12, 3)
    found = Settings(priors="others", epsilon=0.7).by_abc(quick=False)
    assert (found.paper, found.priors, found.epsilon) == (False, "others", 0.7)
    assert Settings(population=50).by_abc(quick=True).ess == 1, "so many particles as are asked for"
    assert Settings(ess=200).by_likelihood().ess == 200


@pytest.mark.parametrize("wrong", [{"paper": True, "priors": "ranges"}, {"paper": True, "ess": 200}])
def test_the_papers_mode_has_neither_priors_nor_an_effective_sample_size(wrong):
    with pytest.raises(ValidationError, match="is not of the paper"):
        Settings(**wrong)
