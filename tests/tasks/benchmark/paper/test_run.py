"""`sinew reproduce paper` on a small study: every figure and number under the paper's names, beside the truth."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from sinew.runner.errors import BadInput
from sinew.tasks.benchmark.paper.published import CORRELATIONS, correlation, exchanged, of_sites, table_3
from sinew.tasks.benchmark.paper.run import reproduce
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import published, virtual_cohort
from sinew.tasks.study import pipeline
from sinew.tasks.study.workspace import Workspace
from tests.tasks.study.test_pipeline import sinew

STUDY = """
name: little-paper
seed: 5
sobol: {base_samples: 32, scrambles: 1, resamples: 10}
importance: {trees: 10, repeats: 2}
calibrate: {evaluations: 30, starts: 1, bayesian: {evaluations: 12, initial: 6, seeds: 8}}
infer: {method: abc, paper: true, population: 8, generations: 2, epsilon: 2.0}
predict: {draws: 4}
compare: {permutations: 20}
"""


def _named_only(figure, file, **_):
    """Leave a file in place of a drawing, which takes most of the time."""
    file.write(b"")


@pytest.fixture(scope="module")
def paper(tmp_path_factory, drawing):
    folder = tmp_path_factory.mktemp("paper")
    (folder / "little.yaml").write_text(STUDY)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Workspace, "client", lambda self: None)
        patch.setattr(pipeline, "_draw", drawing["_draw"])
        patch.setattr(Figure, "savefig", _named_only)
        sinew("reproduce", "paper", "--out", folder / "out", "--study", folder / "little.yaml", "--per-site", "1",
              "--rate", "1", "--quiet")  # fmt: skip
    return folder / "out" / "paper"


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_figures_have_the_papers_numbers(paper):
    drawn = {path.stem for path in paper.glob("figure_*.png")}
    assert {f"figure_{number:02d}" for number in (4, 5, 6, 7, 9, 10, 11, 13, 14)} <= drawn
    assert {f"figure_S{number}" for number in (1, 2, 3, 4, 5)} | {"figure_S6_middle", "figure_S6_proximal"} <= drawn
    assert {"figure_12_distal", "figure_12_middle", "figure_12_proximal"} <= drawn


def test_tables_stand_beside_the_paper_and_the_truth(paper):
    posteriors = rows(paper / "table_3.csv")
    assert len(posteriors) == 3 * 16
    one = next(row for row in posteriors if (row["site"], row["parameter"]) == ("distal", "E_f"))
    assert (one["paper_mean"], one["paper_low"]) == ("216.2", "164.6")
    assert float(one["true_mean"]) == pytest.approx(204.849, abs=1e-3)
    assert float(one["standard_error"]) == pytest.approx(27.426 / 3, abs=1e-3)
    calibrated = rows(paper / "table_2.csv")
    assert len(calibrated) == 3 * 16
    assert {row["specimen"] for row in calibrated} == {"distal/1", "middle/1", "proximal/1"}
    first = next(row for row in calibrated if (row["specimen"], row["parameter"]) == ("distal/1", "E_f"))
    assert first["true"] == "225.145"


def test_the_page_says_what_decides(paper):
    text = (paper / "paper.md").read_text()
    assert "| interval over standard deviation, median (table 3) | 3.30 | 3.29 if uniform, 3.92 if normal |" in text
    assert "share to all digits (table 3) | 20 of 32 | 0 | 0 |" in text
    assert "| E_f, middle (table 3, MPa) | 249.1 ± 46.5 (167.2 to 324.9) | 181.9 ± 5.5 (standard error" in text
    for what in ("Sobol total indices", "random forest", "figure 5", "figure 12", "figure 13"):
        assert what in text


@pytest.mark.parametrize("pair", CORRELATIONS)
def test_published_correlations_are_those_of_table_2_with_matrix_and_fibre_exchanged(pair):
    assert correlation(*exchanged(pair)) == pytest.approx(CORRELATIONS[pair], abs=0.006)


def test_what_was_published_is_whole():
    names = set(published().columns) - {"site", "specimen", "rmse_N"}
    assert set(table_3()) == {(site, name) for site in ("distal", "middle", "proximal") for name in names}
    for one in table_3().values():
        assert one.low < one.mean < one.high
    proximal = [271.839, 174.056, 188.282, 236.762, 230.546, 227.843, 275.0, 191.018, 183.61]
    assert of_sites()["proximal", "E_f"].sd == pytest.approx(np.std(proximal, ddof=1))


@pytest.mark.parametrize("there", [("paper", "thesis.tex"), ("study.yaml", None), ("notes.txt", None)])
def test_a_folder_with_anything_else_is_refused_and_left_as_it_is(tmp_path, there):
    name, inside = there
    mine = tmp_path / name / inside if inside else tmp_path / name
    mine.parent.mkdir(exist_ok=True)
    mine.write_text("mine")
    with pytest.raises(BadInput, match=f"holds '{name}'; expected an empty folder, or one of `sinew reproduce paper`"):
        reproduce(tmp_path)
    assert mine.read_text() == "mine"


@pytest.fixture
def little(tmp_path):
    """The study, and what its cohort holds."""
    path = tmp_path / "little.yaml"
    path.write_text(STUDY)
    return path, *virtual_cohort(seed=5, per_site=1, rate_hz=1.0)


@pytest.mark.parametrize("forged", ["forces", "a size"])
def test_specimens_that_others_prepared_are_refused(tmp_path, monkeypatch, little, forged):
    monkeypatch.setattr(pipeline, "check", lambda *_: pytest.fail("it goes on"))
    study, (first, *others), truth = little
    curves = tuple(replace(curve, force_N=3.0 * curve.force_N) for curve in first.curves)
    changed = replace(first, curves=curves) if forged == "forces" else replace(first, width_mm=2.0 * first.width_mm)
    out = tmp_path / "out"
    write_cohort(out / "cohort", [changed, *others], truth)
    with pytest.raises(BadInput, match="cohort: holds other specimens; expected another --out"):
        reproduce(out, study=study, per_site=1, rate_hz=1.0)
    assert not (out / ".cohort").exists()


def test_the_specimens_of_before_are_used_again(tmp_path, monkeypatch, little):
    def stop(*_):
        raise BadInput("here", "it goes on", "nothing else")

    monkeypatch.setattr(pipeline, "check", stop)
    study, specimens, truth = little
    write_cohort(tmp_path / "out" / "cohort", specimens, truth)
    with pytest.raises(BadInput, match="it goes on"):
        reproduce(tmp_path / "out", study=study, per_site=1, rate_hz=1.0)


def test_nothing_is_written_through_a_link(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".cohort").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BadInput, match=r"\.cohort: is a link"):
        reproduce(tmp_path / "out")
    assert not list((tmp_path / "elsewhere").iterdir())
