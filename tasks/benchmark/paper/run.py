"""The paper from beginning to end: a cohort made from its table 2, all of its tasks, its figures, tables and numbers.

========================  =============================================================================================
``cohort/``               the virtual specimens; their truth is table 2
``study.yaml``, ``run/``  the study and its result folder
``paper/figure_*``        the paper's figures by their numbers
``paper/table_2.csv``     calibrated parameters beside the true ones, by specimen
``paper/table_3.csv``     posteriors beside the paper's and the true means, by site and parameter
``paper/paper.md``        everything else: paper, truth, here, and why they differ
========================  =============================================================================================
"""

from pathlib import Path
from typing import Any

import pandas as pd

from sinew.runner.errors import BadInput
from sinew.runner.files import remove_folder
from sinew.tasks.benchmark.blind import refuse_others, refuse_strange
from sinew.tasks.benchmark.paper.comparison import comparison
from sinew.tasks.benchmark.paper.pictures import pictures
from sinew.tasks.benchmark.paper.published import of_sites, table_3
from sinew.tasks.benchmark.tables import as_markdown
from sinew.tasks.calibrate.result import CalibrateResult
from sinew.tasks.cluster.spec import cluster_of
from sinew.tasks.data.cohort import read_cohort, write_cohort
from sinew.tasks.data.virtual import published, virtual_cohort
from sinew.tasks.infer.abc.result import AbcResult
from sinew.tasks.infer.settings import Settings as InferSettings
from sinew.tasks.sobol.settings import Settings as SobolSettings
from sinew.tasks.study import pipeline
from sinew.tasks.study.files import write_text
from sinew.tasks.study.resources import resource
from sinew.tasks.study.settings_file import as_yaml, from_yaml
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import check_folder, open_workspace

STUDY = "configs/tendon.yaml"
MADE = (".cohort", "cohort", "study.yaml", "run", "paper")  # the first stands alone in a folder that was begun
TASKS = ("sobol", "importance", "calibrate", "infer", "predict", "compare")


def reproduce(
    out: Path, *, study: Path | None = None, per_site: int = 9, rate_hz: float = 100.0, workers: int | None = None,
    quiet: bool = False,
) -> list[str]:  # fmt: skip
    """Run the paper in ``out``, or what is left of it; returns the numbers of figures that the study does not draw.

    ``study``: settings in place of the paper's sizes. Raises :class:`BadInput`.
    """
    source = study or resource(STUDY)
    asked = read_study(source)
    if asked.section(InferSettings).chosen(quick=asked.simulator.name == "uniaxial") != "abc":
        raise BadInput(f"{source}: infer", "is by likelihood", "method: abc, as in the paper")
    if asked.section(SobolSettings).groups:
        raise BadInput(f"{source}: sobol.groups", "are given", "single parameters, as in the paper")
    settings = from_yaml(source.read_text("utf-8"))
    check_folder(out)
    refuse_strange(out)
    refuse_others(out, MADE if (out / "cohort").is_dir() else MADE[:1], "reproduce paper")
    cohort, path = out / "cohort", out / "study.yaml"
    seed = int(settings.get("seed", 0))
    specimens, truth = virtual_cohort(seed=seed, per_site=per_site, rate_hz=rate_hz)
    partial = out / ".cohort"
    remove_folder(partial)
    write_cohort(partial, specimens, truth)
    if not cohort.exists():
        partial.rename(cohort)
    else:
        same = _identities(cohort) == _identities(partial)
        remove_folder(partial)
        if not same:
            expected = "another --out, or the seed, --per-site, --rate and version of before"
            raise BadInput(cohort, "holds other specimens", expected)
    write_text(path, as_yaml({**settings, "cohort": "cohort", "tasks": list(TASKS)}))
    read = read_study(path)
    pipeline.check(read, out / "run", TASKS)
    with open_workspace(read, out=out / "run", cluster=cluster_of(read, workers), quiet=quiet) as workspace:
        results = pipeline.run(workspace, TASKS)
        inferred = results["infer"]
        folder = out / "paper"
        remove_folder(folder)
        folder.mkdir()
        missing = pictures(workspace, inferred, folder)
    write_text(folder / "table_2.csv", _table_2(results["calibrate"]).to_csv(index=False))
    write_text(folder / "table_3.csv", _table_3(inferred).to_csv(index=False))
    write_text(folder / "paper.md", as_markdown([comparison(results)], _lines(results)))
    return missing


def _identities(cohort: Path) -> list[tuple[str, dict[str, Any]]]:
    """Names and curves of all specimens: what is simulated along, and compared with."""
    return [(one.name, one.identity()) for one in read_cohort(cohort).specimens]


def _lines(results: dict[str, Any]) -> list[str]:
    count = len(results["calibrate"].specimens)
    nine = "" if count == 27 else " Truths are those of all nine specimens of a site, of which this run has fewer."
    return [
        f"Pekedis (2025), arXiv:2503.09900, beside this run on {count} virtual specimens that are made from its table "
        f"2: their parameters are known, the measured curves of the paper are not public.{nine}",
        "table_2.csv holds calibrated and true parameters, table_3.csv posteriors beside the paper's; stresses "
        "(figures 14 and S6) are second Piola-Kirchhoff stresses, about 6 % below Cauchy stresses at 4 % strain.",
    ]


def _table_2(result: CalibrateResult) -> pd.DataFrame:
    """Calibrated parameters beside the true ones: a row for each specimen and parameter."""
    truth = {f"{row['site']}/{row['specimen']}": row for row in published().to_dict("records")}
    rows = [
        {
            "specimen": name,
            "parameter": parameter,
            "true": truth[name][parameter],
            "calibrated": value,
            "determined": parameter in fit.determined,
            "on_bound": parameter in fit.on_bound,
        }
        for name, fit in result.specimens.items()
        for parameter, value in fit.parameters.items()
        if parameter in truth[name]
    ]
    return pd.DataFrame(rows)


def _table_3(result: AbcResult) -> pd.DataFrame:
    """Posteriors beside the paper's and the specimens' true mean: a row for each site and parameter."""
    paper, truth = table_3(), of_sites()
    rows: list[dict[str, Any]] = []
    for site, posterior in result.sites.items():
        for name, one in posterior.parameters.items():
            if (site, name) not in paper:
                continue
            known, printed = truth[site, name], paper[site, name]
            rows.append({
                "site": site, "parameter": name,
                "paper_mean": printed.mean, "paper_sd": printed.sd, "paper_low": printed.low,
                "paper_high": printed.high, "true_mean": known.mean, "true_sd": known.sd,
                "standard_error": known.error, "mean": one.mean, "sd": one.sd, "low": one.hdi[0], "high": one.hdi[1],
            })  # fmt: skip
    return pd.DataFrame(rows)
