"""How long a discovery will take."""

from sinew.tasks.discover.settings import Settings
from sinew.tasks.fitting.measured import groups
from sinew.tasks.model.effects import library
from sinew.tasks.study.work import Given, Work, points

FIT_S = 0.2  # for each specimen and form of an effect, with its share of all that follows
POINT_S = 2.8e-4  # beside that, for each point that is fitted
SEVERAL = 1.9  # times that: several effects and laws take nothing where one is named at once, else up to 2.7 times more
ROWS_OF_A_FIT = 60  # evaluations by a solver for each form of an effect
OWN_ROWS_OF_A_FIT = 300  # the same where derivatives are a solver's, too


def work(given: Given, settings: Settings) -> Work:
    """Fits of every form of every candidate to each specimen; pairs of effects, if they are tried, take as much again.

    The embedded simulator does this inside of the fits, and goes on to several effects and laws where one does not
    explain the misfit; a solver evaluates rows.
    """
    specimens = given.specimens(settings.specimens)
    known = library()
    own = given.study.simulator.law != "tendon"
    every = [slug for slug, effect in known.items() if effect.around or not own]
    slugs = every if settings.effects == "all" else settings.effects
    forms = sum(1 + len(known[slug].other_forms) for slug in slugs)
    fitted = sum(groups(curve.protocol).size for curve in specimens[0].curves) / points(specimens[0])
    seconds = sum(forms * (FIT_S + POINT_S * fitted * points(one)) for one in specimens)
    if given.can.effects == "solver":
        rows = OWN_ROWS_OF_A_FIT if own else ROWS_OF_A_FIT
        return Work({one.name: forms * rows for one in specimens}, shared_s=seconds)
    return Work(shared_s=SEVERAL * seconds)
