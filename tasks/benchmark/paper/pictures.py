"""The paper's figures: those of the tasks under the paper's numbers, and figure 11, which only the paper has."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from sinew.runner.files import new_file, read_regular
from sinew.tasks.drawing.figures import COLOURS, STYLE, save, symbol
from sinew.tasks.infer.abc.result import AbcResult, particles_group
from sinew.tasks.study.workspace import Workspace

FIGURES = {  # the paper's numbers, and the files of the tasks
    "figure_04": "calibrate_typical_convergence",
    "figure_05": "calibrate_distal_1",
    "figure_06": "calibrate_samples",
    "figure_07": "calibrate_surrogate",
    "figure_08": "calibrate_correlations",
    "figure_09": "importance",
    "figure_10": "sobol",
    "figure_12_distal": "predict_distal",
    "figure_12_middle": "predict_middle",
    "figure_12_proximal": "predict_proximal",
    "figure_13": "compare",
    "figure_14": "predict_distal_stresses",
    "figure_S1": "calibrate_samples_all",
    "figure_S2": "calibrate_surrogate_all",
    "figure_S3": "infer_distal_joint",
    "figure_S4": "infer_middle_joint",
    "figure_S5": "infer_proximal_joint",
    "figure_S6_middle": "predict_middle_stresses",
    "figure_S6_proximal": "predict_proximal_stresses",
}
SUFFIXES, MAX_BYTES = (".png", ".pdf", ".csv"), 2**28
PAIRS = (("tau_1m", "tau_1f"), ("g_1m", "g_1f"), ("g_2m", "g_2f"), ("E_m", "E_f"), ("nu_m", "alpha_f"))


def pictures(workspace: Workspace, result: AbcResult, out: Path) -> list[str]:
    """Write the paper's figures to ``out``; returns the numbers of those that the run has not drawn."""
    missing = []
    for number, name in FIGURES.items():
        path = workspace.out / "figures" / f"{name}.png"
        if not path.exists():
            missing.append(number)
            continue
        for suffix in SUFFIXES:
            with new_file(out / f"{number}{suffix}") as file:
                file.write(read_regular(path.with_suffix(suffix), MAX_BYTES))
    site = next(iter(result.sites))
    particles = workspace.store.read_result(particles_group(site))
    pairs = [pair for pair in PAIRS if set(pair) <= set(result.names)]
    if pairs:
        table = pd.DataFrame(particles["parameters"].values[-1], columns=result.names)
        table.insert(0, "weight", particles["weight"].values[-1])
        save(joint_pairs(particles, result.names, pairs, site), out, "figure_11", table)
    else:
        missing.append("figure_11")
    return missing


def joint_pairs(particles: xr.Dataset, names: list[str], pairs: Sequence[tuple[str, str]], site: str) -> Figure:
    """Particles of the last generation in chosen pairs of parameters (figure 11); their area is their weight."""
    values, weight = particles["parameters"].values[-1], particles["weight"].values[-1]
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, len(pairs), figsize=(2.2 * len(pairs), 2.3), squeeze=False)
        for axis, (across, up) in zip(axes[0], pairs, strict=True):
            x, y = (values[:, names.index(name)] for name in (across, up))
            axis.scatter(x, y, s=12 * weight * weight.size, color=COLOURS[0], alpha=0.7, lw=0)
            axis.margins(0.15)
            axis.set_xlabel(symbol(across))
            axis.set_ylabel(symbol(up))
        figure.suptitle(site, x=0.01, ha="left", fontsize=10)
    return figure
